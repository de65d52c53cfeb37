"""Paths of road users: straight pieces joined by circular arcs, by the distance along them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Point = tuple[float, float]


@dataclass(frozen=True)
class Pose:
    """A position and heading on the ground: metres, radians from x to the left."""

    x: float
    y: float
    heading: float

    def seen(self, other: Pose) -> tuple[float, float]:
        """Where another pose lies in the frame of this one: metres ahead and to the left.

        >>> Pose(0, 0, 0).seen(Pose(10, 2, 0))
        (10.0, 2.0)
        """
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        dx, dy = other.x - self.x, other.y - self.y
        return float(cos * dx + sin * dy), float(cos * dy - sin * dx)


@dataclass(frozen=True)
class Piece:
    """A straight piece (curvature 0) or an arc that begins at `start`.

    length: metres. curvature: 1/m, positive to the left.
    """

    start: Pose
    length: float
    curvature: float

    def at(self, s: float) -> Pose:
        """Pose after s metres."""
        turned = s * self.curvature
        heading, middle = self.start.heading + turned, self.start.heading + turned / 2
        # The arc's chord, which is s for a straight piece.
        chord = s * np.sinc(turned / 2 / np.pi) if self.curvature else s
        return Pose(
            float(self.start.x + chord * np.cos(middle)),
            float(self.start.y + chord * np.sin(middle)),
            float(heading),
        )

    def foot(self, x: float, y: float) -> float:
        """Metres from the start of this piece to its point nearest to (x, y).

        The piece is taken to have no end.
        """
        c, s = np.cos(self.start.heading), np.sin(self.start.heading)
        dx, dy = x - self.start.x, y - self.start.y
        ahead, left = c * dx + s * dy, -s * dx + c * dy
        if not self.curvature:
            return float(ahead)
        # The angle around the arc's centre, 1/curvature to the left.
        sign = np.sign(self.curvature)
        angle = np.arctan2(ahead, sign * (1 / self.curvature - left))
        return float(angle / abs(self.curvature))


class Path:
    """A path through waypoints with rounded corners.

    It continues straight before the first and after the last waypoint.

    Args:
        waypoints: at least two, (x, y) metres.
        radius: of the corners' arcs, metres; it must fit between neighbouring corners.

    Raises:
        ValueError: for fewer waypoints, equal neighbours, and corners that do not fit.

    >>> path = Path([(0, 0), (10, 0), (10, 10)], radius=2)
    >>> round(path.length, 2), path.project(5, 1)
    (19.14, (5.0, 1.0))
    """

    def __init__(self, waypoints: Sequence[Point], radius: float = 0.0) -> None:
        points = np.asarray(waypoints, dtype=float)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
            raise ValueError(f"a path needs at least two waypoints (x, y), got {list(waypoints)}")
        edges = np.diff(points, axis=0)
        lengths = np.hypot(*edges.T)
        if lengths.min() < 1e-6:
            raise ValueError(
                f"two waypoints in a row are the same: {tuple(points[int(lengths.argmin())])}"
            )
        headings = np.unwrap(np.arctan2(edges[:, 1], edges[:, 0]))
        turns = np.diff(headings)
        cut = radius * np.tan(np.abs(turns) / 2)
        before, after = np.concatenate([[0], cut]), np.concatenate([cut, [0]])
        straight = lengths - before - after
        if straight.min() < -1e-9:
            raise ValueError(
                f"corners of radius {radius:g} m do not fit between waypoints "
                f"{int(straight.argmin()) + 1} and the next"
            )
        self.pieces: list[Piece] = []
        pose = Pose(float(points[0, 0]), float(points[0, 1]), float(headings[0]))
        for i, length in enumerate(straight):
            pose = self._append(pose, float(max(length, 0)), 0.0)
            if i < len(turns) and turns[i] and radius > 0:
                pose = self._append(
                    pose, radius * abs(float(turns[i])), float(np.sign(turns[i])) / radius
                )
            elif i < len(turns):
                pose = Pose(pose.x, pose.y, float(headings[i + 1]))
        self._ends = np.cumsum([piece.length for piece in self.pieces])

    def _append(self, start: Pose, length: float, curvature: float) -> Pose:
        piece = Piece(start, length, curvature)
        self.pieces.append(piece)
        return piece.at(length)

    @property
    def length(self) -> float:
        """Metres from the first to the last waypoint, along the path."""
        return float(self._ends[-1])

    def at(self, s: float) -> Pose:
        """Pose after s metres from the first waypoint; negative before it."""
        i = min(int(np.searchsorted(self._ends, s, side="right")), len(self.pieces) - 1)
        start = self._ends[i - 1] if i else 0.0
        return self.pieces[i].at(float(s - start))

    def project(self, x: float, y: float) -> tuple[float, float]:
        """The point of the path nearest to a given point.

        Returns:
            Metres along the path, and metres from the path to the point, positive to the left.
        """
        best = (np.inf, 0.0, 0.0)
        for i, piece in enumerate(self.pieces):
            start = float(self._ends[i - 1]) if i else 0.0
            low = -np.inf if i == 0 else 0.0
            high = np.inf if i == len(self.pieces) - 1 else piece.length
            s = min(max(piece.foot(x, y), low), high)
            pose = piece.at(s)
            dx, dy = x - pose.x, y - pose.y
            left = float(-np.sin(pose.heading) * dx + np.cos(pose.heading) * dy)
            distance = float(np.hypot(dx, dy))
            if distance < best[0] - 1e-12:
                best = (distance, start + s, left)
        return best[1], best[2]
