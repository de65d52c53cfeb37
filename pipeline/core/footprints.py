"""Footprints of road users on the ground: rectangles and discs, and the distances between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.paths import Pose

Floats = NDArray[np.float64]
PARALLEL_M = 1e-9
"""Distance across a rectangle below which a line runs along it."""


@dataclass(frozen=True)
class Rectangle:
    """A vehicle's footprint: the pose of its middle, half its length and half its width, metres."""

    pose: Pose
    half_length: float
    half_width: float

    @property
    def corners(self) -> Floats:
        """Corners, (4, 2) metres."""
        c, s = np.cos(self.pose.heading), np.sin(self.pose.heading)
        ahead, left = np.array([c, s]) * self.half_length, np.array([-s, c]) * self.half_width
        middle = np.array([self.pose.x, self.pose.y])
        front, rear = middle + ahead, middle - ahead
        return np.stack([front + left, front - left, rear - left, rear + left])

    def distance(self, x: float, y: float) -> float:
        """Metres from the rectangle to a point; 0 inside."""
        c, s = np.cos(self.pose.heading), np.sin(self.pose.heading)
        dx, dy = x - self.pose.x, y - self.pose.y
        ahead = max(0.0, abs(float(c * dx + s * dy)) - self.half_length)
        left = max(0.0, abs(float(-s * dx + c * dy)) - self.half_width)
        return float(np.hypot(ahead, left))

    def crossed_by(self, start: tuple[float, float], end: tuple[float, float]) -> bool:
        """Whether the straight line between two points, metres, touches it (slab method)."""
        c, s = np.cos(self.pose.heading), np.sin(self.pose.heading)
        turned = np.array([[c, s], [-s, c]])
        here = turned @ (np.array(start) - (self.pose.x, self.pose.y))
        along = turned @ (np.array(end) - np.array(start))
        first, last = 0.0, 1.0
        for place, step, half in zip(here, along, (self.half_length, self.half_width), strict=True):
            if abs(step) < PARALLEL_M:
                if abs(place) > half:
                    return False
                continue
            ends = sorted(((-half - place) / step, (half - place) / step))
            first, last = max(first, ends[0]), min(last, ends[1])
        return bool(first <= last)

    def overlaps(self, other: Rectangle) -> bool:
        """Whether the two share a point (separating axis theorem)."""
        for rectangle in (self, other):
            c, s = np.cos(rectangle.pose.heading), np.sin(rectangle.pose.heading)
            for axis in (np.array([c, s]), np.array([-s, c])):
                a, b = self.corners @ axis, other.corners @ axis
                if a.max() < b.min() or b.max() < a.min():
                    return False
        return True
