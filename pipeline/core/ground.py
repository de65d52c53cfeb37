"""Where a detected person stands: the foot of a box on a flat road."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Pinhole:
    """A level camera without distortion.

    Attributes:
        width: of the image, pixels.
        height: of the image, pixels.
        focal_px: focal length, pixels.
        ahead_m: metres ahead of the ego's middle.
        above_m: metres above the road.
    """

    width: int
    height: int
    focal_px: float
    ahead_m: float
    above_m: float

    def ground(self, boxes: ArrayLike) -> Floats:
        """The point of the road under the middle of each box's lower edge.

        Args:
            boxes: (n, 4) left, top, right, bottom in pixels.

        Returns:
            (n, 2) metres in the ego's frame, x ahead and y left; infinite where the edge lies at or
            above the horizon.

        >>> camera = Pinhole(width=320, height=192, focal_px=240, ahead_m=0.5, above_m=1.35)
        >>> camera.ground([(156, 60, 164, 150)]).tolist()
        [[6.5, -0.0]]
        """
        if not len(np.asarray(boxes)):
            return np.zeros((0, 2))
        left, _, right, bottom = np.asarray(boxes, dtype=float).reshape(-1, 4).T
        below = bottom - self.height / 2
        depth = np.divide(
            self.focal_px * self.above_m, below, out=np.full(len(below), np.inf), where=below > 0
        )
        on_road = np.isfinite(depth)
        aside_px = (left + right) / 2 - self.width / 2
        right_m = aside_px / self.focal_px * np.where(on_road, depth, 0)
        return np.stack([depth + self.ahead_m, np.where(on_road, -right_m, np.inf)], axis=1)
