"""The schema of a functional scenario: a town, the ego, the pedestrian and other road users.

Source: thesis section 4.2, layers 1 to 4.
"""

from __future__ import annotations

from itertools import product
from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from pipeline.core.columns import columns
from pipeline.core.encounter import Encounter
from pipeline.core.footprints import Rectangle
from pipeline.core.identity import CampaignId
from pipeline.core.kpi import KPIS
from pipeline.core.paths import Path, Pose
from pipeline.core.space import Space, Written
from pipeline.core.worlds import Worlds
from pipeline.scenarios import people as populations
from pipeline.scenarios.parts import MOST, Name, Part
from pipeline.scenarios.streets import Town, on_asphalt

VehicleKind = Literal["hatchback", "saloon", "van", "bus", "estate", "suv"]
Waypoint = tuple[float, float]
HALF_LENGTHS_M: dict[VehicleKind, float] = {
    "hatchback": 1.95,
    "saloon": 2.25,
    "van": 2.45,
    "bus": 4.5,
    "estate": 2.35,
    "suv": 2.3,
}
HALF_WIDTHS_M: dict[VehicleKind, float] = {
    "hatchback": 0.88,
    "saloon": 0.89,
    "van": 0.95,
    "bus": 1.25,
    "estate": 0.9,
    "suv": 0.95,
}
EGO_HALF_LENGTH_M, EGO_HALF_WIDTH_M = 2.5, 0.95
ON_PATH_M = 0.25
CLEAR_M = 2.2
"""Lateral distance from the middle of the ego's path at which a pedestrian gives no reason to
brake: beyond the lane's edge and a step."""
TIME_LIMIT_S = 12.0
"""A test ends after this time at the latest, even if the ego still rolls or the pedestrian is still
in its path."""

RESERVED = {
    "test_id",
    "index",
    "batch",
    "status",
    "reason",
    *(column.name for column in (*columns(CampaignId), *KPIS)),
    "test",
    "region",
    "end",
    "number",
}
"""Columns of tests.parquet and of the report's table beside the variables."""
BODIES = {"ego", "pedestrian", "street", "world"}
"""Names of a world's own bodies, alone or before an underscore, as in `ego_mass`."""


class Ego(Part):
    """The ego vehicle: constant speed along its path until it brakes.

    It starts `horizon_s` before it would reach the conflict point. path: waypoints, metres; corners
    are rounded with `corner_radius_m`, and both ends continue straight.
    """

    speed_kmh: float = Field(gt=0, le=130)
    path: tuple[Waypoint, ...] = ((-80.0, -1.75), (80.0, -1.75))
    corner_radius_m: float = Field(default=7.75, gt=0, le=60)
    horizon_s: float = Field(gt=0.5, le=10)

    def route(self) -> Path:
        return Path(self.path, self.corner_radius_m)


class Crossing(Part):
    """The pedestrian's straight path through `at`: heading in degrees, 90 is to the left of x.

    role: with `crosses`, `at` lies on the ego's path and is the conflict point. With `stays_clear`,
    the pedestrian never enters the ego's path, and with `absent` there is none: the right answer is
    not to brake.
    """

    role: Literal["crosses", "stays_clear", "absent"] = "crosses"
    at: Waypoint = (0.0, -1.75)
    heading_deg: float = Field(ge=-180, le=180)


class Actor(Part):
    """Another road user: its start and its motion.

    Without `via` it drives straight along its heading; with `via`, through those waypoints, corners
    rounded with `corner_radius_m`. It waits `starts_s` seconds. paint: index of a colour.
    """

    kind: VehicleKind
    x_m: float
    y_m: float
    heading_deg: float = Field(default=0, ge=-180, le=180)
    via: tuple[Waypoint, ...] = ()
    corner_radius_m: float = Field(default=7.75, gt=0, le=60)
    speed_kmh: float = Field(default=0, ge=0, le=130)
    starts_s: float = Field(default=0, ge=0, le=60)
    paint: int = Field(default=0, ge=0, le=MOST)

    def route(self) -> Path:
        via = self.via
        if not via:
            heading = np.radians(self.heading_deg)
            via = ((self.x_m + float(np.cos(heading)), self.y_m + float(np.sin(heading))),)
        return Path([(self.x_m, self.y_m), *via], self.corner_radius_m)

    def travelled(self, time_s: float) -> float:
        """Metres along its route."""
        return max(0.0, time_s - self.starts_s) * self.speed_kmh / 3.6

    def footprint(self, pose: Pose) -> Rectangle:
        return Rectangle(pose, HALF_LENGTHS_M[self.kind], HALF_WIDTHS_M[self.kind])


class FunctionalScenario(Part):
    """A functional scenario with its logical scenario space.

    people: number of the population that its pedestrian comes from. It adds the variable
    `blueprint`, with the population's names, as the last of the space; without it, the space has no
    such variable. constraints: on every test, each a text such as `if rain > 50 then fog = 0` or a
    clause, of which one literal `variable = category` or `variable != category` must hold.
    """

    label: str
    description: str
    town: Town
    ego: Ego
    pedestrian: Crossing
    actors: dict[Name, Actor] = Field(default_factory=dict)
    people: int | None = Field(default=None, ge=1, le=1_000_000)
    space: dict[Name, dict[str, Any]]
    constraints: tuple[Written, ...] = ()

    def logical_space(self) -> Space:
        """The scenario's variables with its constraints."""
        variables = dict(self.space)
        if self.people is not None:
            variables[populations.VARIABLE] = populations.variable(self.people)
        return Space.from_dict(variables, self.constraints)

    @property
    def worlds(self) -> Worlds:
        """Fingerprints of its town and of its people."""
        people = "" if self.people is None else populations.fingerprint(self.people)
        return Worlds.of(self.town.fingerprint, people)

    @property
    def has_pedestrian(self) -> bool:
        return self.pedestrian.role != "absent"

    @property
    def asks_to_brake(self) -> bool:
        """Whether a pedestrian crosses the ego's path."""
        return self.pedestrian.role == "crosses"

    def conflict_s(self) -> float:
        """Metres along the ego's route to the conflict point."""
        return self.ego.route().project(*self.pedestrian.at)[0]

    def start_s(self) -> float:
        """Metres along its route to the start of the ego's middle.

        Unbraked, its front reaches the conflict point after `horizon_s`.
        """
        return self.conflict_s() - self.ego.speed_kmh / 3.6 * self.ego.horizon_s - EGO_HALF_LENGTH_M

    def pedestrian_pose(self, time_s: float, speed_mps: float, shift_m: float = 0.0) -> Pose:
        """Position of the pedestrian.

        Without shift it reaches the conflict point after `horizon_s`, like the unbraked ego's
        front; the shift is along its path.
        """
        along = (time_s - self.ego.horizon_s) * speed_mps + shift_m
        heading = float(np.radians(self.pedestrian.heading_deg))
        x, y = self.pedestrian.at
        return Pose(float(x + along * np.cos(heading)), float(y + along * np.sin(heading)), heading)

    def encounter(self, rain: float = 0.0) -> Encounter:
        """How the ego and the pedestrian meet. rain: 0 to 100 %, which wets the road."""
        return Encounter(
            path=self.ego.route(),
            conflict_m=self.conflict_s(),
            heading=float(np.radians(self.pedestrian.heading_deg)),
            crosses=self.asks_to_brake,
            half_length_m=EGO_HALF_LENGTH_M,
            half_width_m=EGO_HALF_WIDTH_M,
            rain=rain,
            time_limit_s=TIME_LIMIT_S,
        )

    @field_validator("space")
    @classmethod
    def _variables(cls, plain: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        if populations.VARIABLE in plain:
            raise ValueError(
                f"'{populations.VARIABLE}' comes from `people`, the number of a population; "
                "constraints may exclude persons"
            )
        if taken := sorted(RESERVED & set(plain)):
            raise ValueError(
                f"'{taken[0]}' is a column of every table of tests already; choose another name"
            )
        Space.from_dict(plain)
        return plain

    @field_validator("actors")
    @classmethod
    def _bodies(cls, actors: dict[str, Actor]) -> dict[str, Actor]:
        if taken := [name for name in actors if name.partition("_")[0] in BODIES]:
            raise ValueError(
                f"'{taken[0]}' is the name of a body that every world has; choose another name"
            )
        return actors

    @model_validator(mode="after")
    def _can_be_executed(self) -> FunctionalScenario:
        count = len(self.logical_space())
        if count < 2:  # Coverage and diversity count pairs of categories.
            raise ValueError(
                f"space: expected at least two variables, `people` included, got {count}"
            )
        try:
            route = self.ego.route()
        except ValueError as error:
            raise ValueError(f"ego.path: {error}") from error
        self._role_fits(route)
        first, last = self.start_s() - EGO_HALF_LENGTH_M, self.conflict_s() + EGO_HALF_LENGTH_M
        for s in np.arange(first, last, 1.0):
            pose = route.at(float(s))
            if not on_asphalt(self.town, pose.x, pose.y, margin=EGO_HALF_WIDTH_M):
                raise ValueError(f"ego.path: leaves the road at ({pose.x:.1f}, {pose.y:.1f})")
        footprints = {
            "ego": Rectangle(route.at(self.start_s()), EGO_HALF_LENGTH_M, EGO_HALF_WIDTH_M)
        }
        for name, actor in self.actors.items():
            self._drivable(name, actor)
            footprint = actor.footprint(actor.route().at(0))
            for other, taken in footprints.items():
                if footprint.overlaps(taken):
                    raise ValueError(f"actors.{name}: overlaps {other} at the start")
            footprints[name] = footprint
        return self

    def _role_fits(self, route: Path) -> None:
        _, aside = route.project(*self.pedestrian.at)
        if self.pedestrian.role == "crosses" and abs(aside) > ON_PATH_M:
            raise ValueError(
                f"pedestrian.at: {self.pedestrian.at} must lie on the ego's path, "
                f"but lies {abs(aside):.2f} m beside it"
            )
        if self.pedestrian.role == "stays_clear" and (nearest := self._nearest_m(route)) < CLEAR_M:
            raise ValueError(
                f"pedestrian: with role 'stays_clear' it must stay {CLEAR_M:g} m beside the middle "
                f"of the ego's path, but it comes as near as {nearest:.2f} m"
            )

    def _nearest_m(self, route: Path) -> float:
        """Smallest distance of any test's pedestrian to the middle of the ego's path, metres."""
        ranges = {v.name: (v.low, v.high) for v in self.logical_space().variables}
        speeds = ranges.get("pedestrian_speed", (0.0, 0.0))
        shifts = ranges.get("pedestrian_shift", (0.0, 0.0))
        # A test moves the pedestrian along a line: by its speed times the time from the conflict,
        # plus its shift.
        times = (-self.ego.horizon_s, TIME_LIMIT_S - self.ego.horizon_s)
        ends = [time_s * speed + shift for time_s, speed, shift in product(times, speeds, shifts)]
        metres = np.linspace(min(ends), max(ends), 2 + int((max(ends) - min(ends)) / 0.25))
        poses = [self.pedestrian_pose(self.ego.horizon_s, 0.0, float(along)) for along in metres]
        return min(abs(route.project(pose.x, pose.y)[1]) for pose in poses)

    def _drivable(self, name: str, actor: Actor) -> None:
        try:
            route = actor.route()
        except ValueError as error:
            raise ValueError(f"actors.{name}.via: {error}") from error
        for time_s in np.arange(0, self.ego.horizon_s, 0.25):
            pose = route.at(actor.travelled(float(time_s)))
            if not on_asphalt(self.town, pose.x, pose.y, margin=HALF_WIDTHS_M[actor.kind] - 0.15):
                raise ValueError(
                    f"actors.{name}: is off the road at ({pose.x:.1f}, {pose.y:.1f}) "
                    f"after {time_s:g} s"
                )
