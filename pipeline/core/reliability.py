"""Makes a score mean what it says: the share of detections with that score that are right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.linear_model import LogisticRegression

EDGE = 1e-6


@dataclass(frozen=True)
class Calibration:
    """Platt scaling: calibrated logit = slope * logit + offset. The order of scores, and so average precision, stays."""

    slope: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        if not self.slope > 0 or not np.isfinite(self.offset):
            raise ValueError(f"slope must be positive and offset finite, got {self.slope} and {self.offset}")

    def apply(self, scores: ArrayLike) -> NDArray[np.float64]:
        """Scores in [0, 1] to calibrated ones."""
        logit = self.slope * _logit(scores) + self.offset
        return np.asarray(1 / (1 + np.exp(-logit)))


def platt(scores: ArrayLike, right: ArrayLike) -> Calibration:
    """Fit the calibration to (n,) scores in [0, 1] and whether each detection was right (Platt 1999).

    The identity if all are right or all are wrong, or a higher score does not mean right more often: there is nothing to learn then.
    """
    x, y = _logit(scores), np.asarray(right, dtype=bool)
    if len(np.unique(y)) < 2:
        return Calibration()
    fitted = LogisticRegression(C=1e6).fit(x[:, None], y)
    slope, offset = float(fitted.coef_[0, 0]), float(fitted.intercept_[0])
    return Calibration(slope, offset) if slope > 0 else Calibration()


def _logit(scores: ArrayLike) -> NDArray[np.float64]:
    share = np.clip(np.asarray(scores, dtype=float), EDGE, 1 - EDGE)
    return np.asarray(np.log(share / (1 - share)))
