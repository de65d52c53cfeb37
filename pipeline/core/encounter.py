"""How the ego and the pedestrian meet: gap, contact, collision path and the test's end."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.core.footprints import Rectangle
from pipeline.core.ground import Floats
from pipeline.core.kpi import MIN_SPEED_MPS
from pipeline.core.paths import Path, Pose
from pipeline.errors import SimulationError

ALONG = np.sin(np.radians(15))
"""Sine of the angle to the ego's path below which a pedestrian walks along it, not across."""


@dataclass(frozen=True)
class RoadUsers:
    """Positions at one time. Metres, seconds and radians in the world frame, x ahead and y left.

    Raises `SimulationError` if the ego's position is not finite.

    Attributes:
        time_s: since the start of the test.
        travelled_m: of the ego's middle along its path; `path.project(x, y)[0]` for an ego that
            is not driven by this number.
        ego: pose of the ego's middle.
        ego_speed_mps: speed of the ego, at least 0.
        pedestrian: pose of the pedestrian's middle; None without a pedestrian.
    """

    time_s: float
    travelled_m: float
    ego: Pose
    ego_speed_mps: float
    pedestrian: Pose | None

    def __post_init__(self) -> None:
        if not math.isfinite(self.travelled_m):
            raise SimulationError(
                f"the ego's position became {self.travelled_m} at {self.time_s:.2f} s"
            )


@dataclass(frozen=True)
class Situation:
    """How near a collision is.

    Attributes:
        gap_m: distance between the footprints, metres: 0 at a contact, NaN without a pedestrian.
        contact: whether the footprints touch.
        on_collision_path: whether the pedestrian crosses the corridor that the ego sweeps and has
            not yet left it.
        conflict_distance_m: metres from the ego's front to the conflict point, at least 0. A
            pedestrian who walks along the path is the conflict point itself.
        is_over: whether the outcome is certain: a contact, a stopped ego, no conflict left, or
            time is up.
    """

    gap_m: float
    contact: bool
    on_collision_path: bool
    conflict_distance_m: float
    is_over: bool


@dataclass(frozen=True)
class Encounter:
    """The geometry of one test, from which the closed loop judges the positions of road users.

    Attributes:
        path: of the ego's middle, metres in the world frame.
        conflict_m: metres along the path to the conflict point.
        heading: of the pedestrian, radians in the world frame.
        crosses: whether the pedestrian crosses the path, so that braking is right.
        half_length_m: half the ego's length.
        half_width_m: half the ego's width.
        rain: 0 to 100 %, which wets the road.
        pedestrian_radius_m: radius of the disc on which the pedestrian stands.
        time_limit_s: the test ends after this time at the latest.
    """

    path: Path
    conflict_m: float
    heading: float
    crosses: bool
    half_length_m: float
    half_width_m: float
    rain: float = 0.0
    pedestrian_radius_m: float = 0.25
    time_limit_s: float = 12.0

    @cached_property
    def across(self) -> float:
        """The pedestrian's motion to the ego's left, per metre walked."""
        return float(np.sin(self.heading - self.path.at(self.conflict_m).heading))

    def gap_m(self, users: RoadUsers) -> float:
        """Distance between the footprints, metres: 0 at a contact, NaN without a pedestrian."""
        if users.pedestrian is None:
            return float("nan")
        footprint = Rectangle(users.ego, self.half_length_m, self.half_width_m)
        distance = footprint.distance(users.pedestrian.x, users.pedestrian.y)
        return max(0.0, distance - self.pedestrian_radius_m)

    def situation(self, users: RoadUsers) -> Situation:
        """Judge the positions of the road users."""
        along_m, on_path, walker = self.conflict_m, False, users.pedestrian
        if self.crosses and walker is not None:
            s, left = self.path.project(walker.x, walker.y)
            reach = self.half_width_m + self.pedestrian_radius_m
            on_path = bool(np.sign(self.across) * left <= reach)
            if abs(self.across) < ALONG:  # Walks along the path, so is the conflict point itself.
                along_m, on_path = s, True
        conflict_distance_m = max(0.0, along_m - users.travelled_m - self.half_length_m)
        gap_m = self.gap_m(users)
        no_conflict = not on_path if self.crosses else conflict_distance_m <= 0
        stopped = users.ego_speed_mps <= MIN_SPEED_MPS
        late = users.time_s >= self.time_limit_s
        return Situation(
            gap_m=gap_m,
            contact=gap_m <= 0,
            on_collision_path=on_path,
            conflict_distance_m=conflict_distance_m,
            is_over=gap_m <= 0 or stopped or no_conflict or late,
        )

    def in_path(self, points: Floats, ego: Pose, margin_m: float) -> NDArray[np.bool_]:
        """Whether points of the road lie in the corridor that the ego will sweep, (n,).

        Args:
            points: (n, 2) metres in the ego's frame, x ahead and y left; infinite for none.
            ego: pose of the ego's middle.
            margin_m: metres beside the ego that still belong to the corridor.
        """
        reach = self.half_width_m + margin_m
        cos, sin = np.cos(ego.heading), np.sin(ego.heading)
        inside = np.zeros(len(points), bool)
        for i, (ahead, left) in enumerate(points):
            if np.isfinite(ahead):
                x, y = ego.x + cos * ahead - sin * left, ego.y + sin * ahead + cos * left
                inside[i] = abs(self.path.project(x, y)[1]) <= reach
        return inside
