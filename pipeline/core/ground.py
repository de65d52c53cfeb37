"""Where a detected person stands: the foot of a box on a flat road."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Pinhole:
    """A level camera without distortion. width, height: pixels; focal_px: pixels; ahead_m, above_m: its place in the ego's frame."""

    width: int
    height: int
    focal_px: float
    ahead_m: float
    above_m: float

    def ground(self, boxes: ArrayLike) -> Floats:
        """The point of the road under the middle of each box's lower edge, (n, 2) metres in the ego's frame, x ahead and y left.

        boxes: (n, 4) left, top, right, bottom in pixels. Infinite where the edge lies at or above the horizon.
        """
        left, _, right, bottom = np.asarray(boxes, dtype=float).reshape(-1, 4).T
        below = bottom - self.height / 2
        depth = np.divide(
            self.focal_px * self.above_m, below, out=np.full(len(below), np.inf), where=below > 0
        )
        right_m = (
            ((left + right) / 2 - self.width / 2)
            / self.focal_px
            * np.where(np.isfinite(depth), depth, 0)
        )
        return np.stack(
            [depth + self.ahead_m, np.where(np.isfinite(depth), -right_m, np.inf)], axis=1
        )
