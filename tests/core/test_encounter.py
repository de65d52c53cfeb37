"""How ego and pedestrian meet: by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.encounter import Encounter, RoadUsers
from pipeline.core.ground import Pinhole
from pipeline.core.paths import Path, Pose
from pipeline.errors import SimulationError

STRAIGHT = Encounter(
    path=Path([(0, 0), (100, 0)]),
    conflict_m=50,
    heading=np.pi / 2,
    crosses=True,
    half_length_m=2.5,
    half_width_m=1,
)
TURN = Path([(-80, -1.75), (0, -1.75), (0, 80)], radius=9)


def users(s: float, x: float, y: float, speed: float = 10) -> RoadUsers:
    return RoadUsers(1.0, s, Pose(s, 0, 0), speed, Pose(x, y, np.pi / 2))


@pytest.mark.parametrize(
    ("s", "y", "gap_m", "on_path", "distance_m", "is_over"),
    [
        (20, -5, np.hypot(27.5, 4) - 0.25, True, 27.5, False),
        (20, 1.25, np.hypot(27.5, 0.25) - 0.25, True, 27.5, False),
        (20, 1.3, np.hypot(27.5, 0.3) - 0.25, False, 27.5, True),
        (47.25, 0, 0, True, 0.25, True),
        (49, 0, 0, True, 0, True),
    ],
)
def test_a_pedestrian_who_crosses(
    s: float, y: float, gap_m: float, on_path: bool, distance_m: float, is_over: bool
) -> None:
    situation = STRAIGHT.situation(users(s, 50, y))
    assert situation.gap_m == pytest.approx(gap_m) and situation.contact == (gap_m == 0)
    assert situation.on_collision_path == on_path and situation.is_over == is_over
    assert situation.conflict_distance_m == pytest.approx(distance_m)


def test_a_pedestrian_who_walks_along_the_path_is_the_conflict_point() -> None:
    along = replace(STRAIGHT, heading=0.1)
    situation = along.situation(users(20, 60, 5))
    assert situation.on_collision_path and situation.conflict_distance_m == pytest.approx(37.5)


def test_without_a_pedestrian_a_test_ends_behind_the_conflict_point() -> None:
    nobody = replace(STRAIGHT, crosses=False)
    ahead, behind = (nobody.situation(replace(users(s, 0, 0), pedestrian=None)) for s in (20, 47.5))
    assert np.isnan(ahead.gap_m) and not ahead.contact and not ahead.on_collision_path
    assert (ahead.is_over, behind.is_over) == (False, True)


def test_a_test_ends_when_the_ego_stops_or_time_is_up() -> None:
    assert STRAIGHT.situation(users(20, 50, 0, speed=0.05)).is_over
    assert STRAIGHT.situation(replace(users(20, 50, 0), time_s=12.0)).is_over


def test_a_lost_ego_is_an_error() -> None:
    with pytest.raises(SimulationError, match="the ego's position became nan at 1.00 s"):
        users(float("nan"), 50, 0)


@pytest.mark.parametrize(
    ("margin_m", "in_path"), [(0.34, [False, True, False]), (0.35, [True, True, False])]
)
def test_a_detection_is_in_the_path_up_to_the_margin(margin_m: float, in_path: list[bool]) -> None:
    """In a left turn of 9 m, the road 5 m ahead lies hypot(9, 5) - 9 = 1.296 m to the right.

    3 m further to the left it lies 1.19 m to the left, 1.5 m further to the right 2.63 m to the
    right.
    """
    turn = Encounter(TURN, 80, 0.0, True, half_length_m=2.5, half_width_m=0.95)
    camera = Pinhole(width=320, height=192, focal_px=240, ahead_m=0.5, above_m=1.35)
    per_metre = camera.focal_px / (5 - camera.ahead_m)
    bottom = camera.height / 2 + camera.above_m * per_metre
    feet = [160 + metres * per_metre for metres in (0, -3, 1.5)]
    points = camera.ground([(x - 4, 60, x + 4, bottom) for x in feet])
    turning = TURN.at(71 + 9 * np.pi * 3 / 16)  # The turn begins after 71 m.
    assert turn.in_path(points, turning, margin_m).tolist() == in_path
    above_the_horizon = camera.ground([(156, 60, 164, 90)])
    assert turn.in_path(above_the_horizon, turning, margin_m).tolist() == [False]
