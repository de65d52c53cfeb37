"""Calibrates scores: a score becomes the share of correct detections with that score."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

EDGE = 1e-6


@dataclass(frozen=True)
class Calibration:
    """Platt scaling: calibrated logit = slope * logit + offset.

    It keeps the order of scores, and so average precision.
    """

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
    """Fit the calibration (Platt 1999).

    Args:
        scores: (n,) in [0, 1].
        right: (n,) whether each detection was correct.

    Returns:
        The calibration; the identity if all or none are correct, or if a higher score does not
        mean correct more often.
    """
    # Imported late: that takes a second, which every test worker would pay.
    from sklearn.linear_model import LogisticRegression

    x, y = _logit(scores), np.asarray(right, dtype=bool)
    if len(np.unique(y)) < 2:
        return Calibration()
    fitted = LogisticRegression(C=1e6).fit(x[:, None], y)
    slope, offset = float(fitted.coef_[0, 0]), float(fitted.intercept_[0])
    return Calibration(slope, offset) if slope > 0 else Calibration()


@dataclass(frozen=True)
class Bin:
    """Detections with similar scores: mean score, share of correct ones in [0, 1], and count."""

    score: float
    right: float
    count: int


def reliability(scores: ArrayLike, right: ArrayLike, bins: int = 10) -> tuple[Bin, ...]:
    """The reliability diagram, without empty bins (Guo et al. 2017, Eq. 2).

    Args:
        scores: (n,) in [0, 1].
        right: (n,) whether each detection was correct.
        bins: number of bins of equal width.

    Raises:
        ValueError: the lists have different lengths.

    >>> reliability([0.1, 0.12, 0.9], [False, True, True], bins=2)
    (Bin(score=0.11, right=0.5, count=2), Bin(score=0.9, right=1.0, count=1))
    """
    x, y = np.asarray(scores, dtype=float), np.asarray(right, dtype=bool)
    if x.shape != y.shape or x.ndim != 1:
        raise ValueError(
            f"scores and right must be lists of equal length, got shapes {x.shape} and {y.shape}"
        )
    numbers = np.minimum((x * bins).astype(int), bins - 1)
    diagram = []
    for number in np.unique(numbers):
        rows = numbers == number
        diagram.append(Bin(float(x[rows].mean()), float(y[rows].mean()), int(rows.sum())))
    return tuple(diagram)


def calibration_error(diagram: Sequence[Bin]) -> float:
    """Expected calibration error in [0, 1] (Guo et al. 2017, Eq. 3).

    The mean distance of score and share of correct detections, weighted by their number.
    """
    total = sum(each.count for each in diagram)
    if not total:
        return 0.0
    return sum(each.count * abs(each.score - each.right) for each in diagram) / total


def _logit(scores: ArrayLike) -> NDArray[np.float64]:
    share = np.clip(np.asarray(scores, dtype=float), EDGE, 1 - EDGE)
    return np.asarray(np.log(share / (1 - share)))
