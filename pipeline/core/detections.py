"""What a detector reports for one image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Detections:
    """Pedestrians that a detector reports in one image, best first.

    Attributes:
        boxes: (n, 4) float32, finite: left, top, right, bottom in pixels.
        scores: (n,) float32 in [0, 1], descending.

    Raises:
        ValueError: for another shape, other numbers, or another order.

    >>> len(Detections.none().scores)
    0
    """

    boxes: NDArray[np.float32]
    scores: NDArray[np.float32]

    def __post_init__(self) -> None:
        if self.boxes.ndim != 2 or self.boxes.shape[1] != 4:
            raise ValueError(f"boxes must have shape (n, 4), got {self.boxes.shape}")
        if not np.isfinite(self.boxes).all():
            raise ValueError("boxes must be finite")
        if self.scores.shape != (len(self.boxes),):
            raise ValueError(
                f"scores must have shape ({len(self.boxes)},), got {self.scores.shape}"
            )
        if len(self.scores) and not (
            float(self.scores.min()) >= 0 and float(self.scores.max()) <= 1
        ):
            raise ValueError(
                f"scores must be in [0, 1], got {self.scores.min()} to {self.scores.max()}"
            )
        if (np.diff(self.scores) > 0).any():
            raise ValueError("scores must descend")

    @staticmethod
    def none() -> Detections:
        """No detection."""
        return Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32))
