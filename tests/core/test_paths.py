"""Paths: straight pieces and arcs, and projection onto them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from pipeline.core.footprints import Rectangle
from pipeline.core.paths import Path, Pose

RIGHT_TURN, RIGHT_RADIUS = [(-50.0, -1.75), (8.25, -1.75), (8.25, -40.0)], 7.75
LEFT_TURN, LEFT_RADIUS = [(-50.0, -1.75), (11.75, -1.75), (11.75, 40.0)], 9.0


@pytest.mark.parametrize(
    ("waypoints", "radius", "turn"),
    [(RIGHT_TURN, RIGHT_RADIUS, -np.pi / 2), (LEFT_TURN, LEFT_RADIUS, np.pi / 2)],
)
def test_a_corner_is_an_arc_between_two_straights(
    waypoints: list[tuple[float, float]], radius: float, turn: float
) -> None:
    path = Path(waypoints, radius)
    assert path.at(0) == Pose(-50, -1.75, 0)
    end = path.at(path.length)
    assert (end.x, end.y) == pytest.approx(waypoints[-1]) and end.heading == pytest.approx(turn)
    straight = sum(float(np.hypot(*np.subtract(b, a))) for a, b in pairwise(waypoints))
    assert path.length == pytest.approx(straight - 2 * radius + radius * np.pi / 2)
    steps = [path.at(s) for s in np.arange(-5, path.length + 5, 0.01)]
    moved = [np.hypot(b.x - a.x, b.y - a.y) for a, b in pairwise(steps)]
    assert np.allclose(moved, 0.01, atol=1e-5)
    assert [piece.curvature for piece in path.pieces] == pytest.approx(
        [0, np.sign(turn) / radius, 0]
    )


@pytest.mark.parametrize(
    "path", [Path(RIGHT_TURN, RIGHT_RADIUS), Path(LEFT_TURN, LEFT_RADIUS), Path([(0, 0), (1, 1)])]
)
def test_projection_undoes_at(path: Path) -> None:
    for s in np.linspace(-10, path.length + 10, 60):
        pose = path.at(float(s))
        for left in (-0.8, 0.0, 2.5):
            x, y = pose.x - left * np.sin(pose.heading), pose.y + left * np.cos(pose.heading)
            assert path.project(x, y) == pytest.approx((s, left), abs=1e-6)


@pytest.mark.parametrize(
    ("waypoints", "radius", "message"),
    [
        ([(0, 0)], 1, "at least two"),
        ([(0, 0), (0, 0)], 1, "the same"),
        ([(0, 0), (3, 0), (3, 3)], 5, "do not fit between waypoints"),
    ],
)
def test_wrong_paths_are_refused(
    waypoints: list[tuple[float, float]], radius: float, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Path(waypoints, radius)


def test_footprints_know_their_distance_and_overlap() -> None:
    car = Rectangle(Pose(10, 0, np.pi / 2), 2, 1)
    assert car.distance(10, 0) == car.distance(10.9, 1.9) == 0
    assert car.distance(12, 0) == pytest.approx(1)
    assert car.distance(14, 6) == pytest.approx(5)
    assert car.overlaps(Rectangle(Pose(12.4, 0, 0), 1.5, 0.5)) and not car.overlaps(
        Rectangle(Pose(12.6, 0, 0), 1.5, 0.5)
    )
    # Their bounding boxes overlap, but the rectangles do not.
    assert not Rectangle(Pose(0, 0, np.pi / 4), 4, 0.2).overlaps(
        Rectangle(Pose(2.5, -1.0, np.pi / 4), 1, 0.2)
    )
