"""Calibrates scores: a score becomes the share of correct detections among those with that score."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

EDGE = 1e-6


@dataclass(frozen=True)
class Calibration:
    """Platt scaling: calibrated logit = slope * logit + offset. It keeps the order of scores, and so average precision."""

    slope: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        if not self.slope > 0 or not np.isfinite(self.offset):
            raise ValueError(
                f"slope must be positive and offset finite, got {self.slope} and {self.offset}"
            )

    def apply(self, scores: ArrayLike) -> NDArray[np.float64]:
        """Convert scores in [0, 1] to calibrated scores."""
        logit = self.slope * _logit(scores) + self.offset
        return np.asarray(1 / (1 + np.exp(-logit)))

    def undo(self, scores: ArrayLike) -> NDArray[np.float64]:
        """Convert calibrated scores back: the scores in (0, 1) that `apply` turns into these."""
        logit = (_logit(scores) - self.offset) / self.slope
        return np.clip(1 / (1 + np.exp(-logit)), EDGE, 1 - EDGE)


def platt(scores: ArrayLike, right: ArrayLike) -> Calibration:
    """Fit the calibration to (n,) scores in [0, 1] and whether each detection was correct (Platt 1999).

    Returns the identity if all or none are correct, or if a higher score does not mean correct more often.
    """
    from sklearn.linear_model import (
        LogisticRegression,
    )  # Takes a second to import, which every test worker would pay.

    x, y = _logit(scores), np.asarray(right, dtype=bool)
    if len(np.unique(y)) < 2:
        return Calibration()
    fitted = LogisticRegression(C=1e6).fit(x[:, None], y)
    slope, offset = float(fitted.coef_[0, 0]), float(fitted.intercept_[0])
    return Calibration(slope, offset) if slope > 0 else Calibration()


@dataclass(frozen=True)
class Bin:
    """Detections with scores in one bin: their mean score and share of correct ones, both in [0, 1], and their number."""

    score: float
    right: float
    count: int


def reliability(scores: ArrayLike, right: ArrayLike, bins: int = 10) -> tuple[Bin, ...]:
    """The reliability diagram of (n,) scores in [0, 1] and whether each detection was correct: bins of equal width, without empty ones.

    Source: Guo et al., On calibration of modern neural networks, 2017, Eq. 2.
    """
    x, y = np.asarray(scores, dtype=float), np.asarray(right, dtype=bool)
    if x.shape != y.shape or x.ndim != 1:
        raise ValueError(
            f"scores and right must be lists of equal length, got shapes {x.shape} and {y.shape}"
        )
    numbers = np.minimum((x * bins).astype(int), bins - 1)
    chosen = ((numbers == number) for number in np.unique(numbers))
    return tuple(
        Bin(float(x[rows].mean()), float(y[rows].mean()), int(rows.sum())) for rows in chosen
    )


def calibration_error(diagram: Sequence[Bin]) -> float:
    """Expected calibration error in [0, 1]: mean distance of score and share of correct ones, weighted by detections (Guo et al., Eq.
    3)."""
    total = sum(shown.count for shown in diagram)
    return (
        sum(shown.count * abs(shown.score - shown.right) for shown in diagram) / total
        if total
        else 0.0
    )


def _logit(scores: ArrayLike) -> NDArray[np.float64]:
    share = np.clip(np.asarray(scores, dtype=float), EDGE, 1 - EDGE)
    return np.asarray(np.log(share / (1 - share)))
