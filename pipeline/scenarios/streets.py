"""The layout of a town's streets: asphalt, lanes, kerbs, crosswalks; to draw, drive and export.

World frame, metres: x along the main street in the ego's driving direction, y left; for a curved
main street, the direction at x = 0. The main street's rightmost lane, the ego's, has its middle
1.75 m right of the street's axis. Right-hand traffic.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pipeline.core.paths import Piece, Pose
from pipeline.scenarios.parts import Part, Seed

LANE_WIDTH = 3.5
PAVEMENT_WIDTH = 3.0
BAY_DEPTH = 3.1
CORNER_RADIUS = 6.0
"""Radius of the kerbs where two streets meet."""
CROSSWALK_M = 3.0
"""Width of a crosswalk, along its street."""
RAIL_M = 0.72
"""Distance of each rail from the middle of the train line."""
START_X, END_X = -75.0, 150.0
SIDE_LENGTH = 85.0
SHARPEST = 1 / 50
"""The strongest curvature of a street, 1/m: beyond it the houses on the inner side would meet."""
Side = Literal["left", "right"]
OnStreet = Annotated[float, Field(ge=START_X + 5, le=END_X - 5)]


class Junction(Part):
    """A T-junction: at x a side street leaves the main street to one side, at a right angle."""

    x_m: float = Field(ge=-40, le=60)
    side: Side


class Crosswalk(Part):
    """A marked crosswalk on a street.

    at_m: position of its middle along the street: x on the main street, metres from the main
    street's kerb on the side street.
    """

    street: Literal["main", "side"] = "main"
    at_m: float


class Town(Part):
    """The streets, their style and the seed of everything random: houses, trees, textures.

    lanes_ahead: lanes in the ego's direction; there is one oncoming lane. curvature_1pm: of the
    main street, positive to the left. bus_bay: on the nearside, from x to x. vegetation: hedges
    and dense trees. crosswalks: on either street. rails_x_m: a train line crosses the main street
    here. trees: (x, y) of single trees besides the random ones.
    """

    style: Literal["urban", "suburban"] = "urban"
    seed: Seed
    lanes_ahead: int = Field(default=1, ge=1, le=2)
    curvature_1pm: float = Field(default=0.0, ge=-SHARPEST, le=SHARPEST)
    bus_bay: tuple[OnStreet, OnStreet] | None = None
    vegetation: Literal["none", "left", "right", "both"] = "none"
    junction: Junction | None = None
    crosswalks: tuple[Crosswalk, ...] = ()
    rails_x_m: float | None = Field(default=None, ge=-40, le=80)
    trees: tuple[tuple[float, float], ...] = ()

    @model_validator(mode="after")
    def _fits(self) -> Town:
        if self.bus_bay and self.bus_bay[0] >= self.bus_bay[1]:
            raise ValueError(f"bus_bay must run from a smaller to a larger x, got {self.bus_bay}")
        for crosswalk in self.crosswalks:
            if crosswalk.street == "side" and self.junction is None:
                raise ValueError(
                    "crosswalks: one lies on the side street, but the town has no junction"
                )
        for crosswalk in self.crosswalks:
            street = streets(self)[crosswalk.street == "side"]
            if not street.start <= crosswalk.at_m <= street.end:
                limits = f"[{street.start:g}, {street.end:g}]"
                raise ValueError(
                    f"crosswalks: at_m must be in {limits} on the {street.name} street, "
                    f"got {crosswalk.at_m:g}"
                )
        if self.curvature_1pm and (self.junction or self.rails_x_m is not None):
            raise ValueError(
                "curvature_1pm: a street with a junction or a train line must be straight"
            )
        if self.bus_bay:
            first, last = self.bus_bay
            for gap in streets(self)[0].gaps:
                if gap.side == -1 and gap.start < last + 1 and gap.end > first - 1:
                    raise ValueError(
                        f"bus_bay {self.bus_bay} overlaps the junction or the train line"
                    )
        for x, y in self.trees:
            if on_asphalt(self, x, y, margin=-0.3):
                raise ValueError(f"trees: ({x:g}, {y:g}) stands on the road")
        return self

    @property
    def fingerprint(self) -> str:
        """Identifies a town without revealing it: hexadecimal, from SHA-256.

        Covers style and seed, which determine houses and textures: with another street or one more
        tree it is still the same town.
        """
        return hashlib.sha256(f"{self.style} {self.seed}".encode()).hexdigest()[:16]

    def overgrown(self, side: int) -> bool:
        """Whether hedges and dense trees line this side of the streets: 1 left, -1 right."""
        return self.vegetation == "both" or self.vegetation == ("left" if side > 0 else "right")


@dataclass(frozen=True)
class Gap:
    """Interruption of a street's side from `start` to `end` metres along it.

    side: 1 left, -1 right. mouth: whether another street interrupts it.
    """

    side: int
    start: float
    end: float
    mouth: bool


@dataclass(frozen=True)
class Street:
    """A street in its own frame: u along it, v to its left, from `start` to `end`.

    origin, angle: pose of that frame in the world, metres and radians. curvature: of its axis, 1/m,
    positive to the left. right, left: distances of the kerbs from its axis. middle: v of the line
    between the two directions. bay: bus bay on the right.
    """

    name: str
    origin: tuple[float, float]
    angle: float
    curvature: float
    start: float
    end: float
    right: float
    left: float
    middle: float
    bay: tuple[float, float] | None
    gaps: tuple[Gap, ...]

    @property
    def axis(self) -> Piece:
        """Its axis, by u."""
        return Piece(Pose(*self.origin, self.angle), np.inf, self.curvature)

    def pose(self, u: float, v: float) -> Pose:
        """Pose in the world of a point of the street's frame, looking along the street."""
        on = self.axis.at(u)
        x, y = on.x - v * np.sin(on.heading), on.y + v * np.cos(on.heading)
        return Pose(float(x), float(y), on.heading)

    def world(self, u: float, v: float) -> tuple[float, float]:
        """Convert a point of the street's frame to world coordinates."""
        pose = self.pose(u, v)
        return pose.x, pose.y

    def local(self, x: float, y: float) -> tuple[float, float]:
        """Convert a point of the world to (u, v)."""
        u = self.axis.foot(x, y)
        on = self.axis.at(u)
        return u, float(-np.sin(on.heading) * (x - on.x) + np.cos(on.heading) * (y - on.y))

    def edge(self, side: int, u: float | None = None) -> float:
        """Distance of the kerb from the axis, the bay's beside a bus bay.

        Without u: the largest along the whole side.
        """
        if side > 0:
            return self.left
        beside_bay = self.bay is not None and (u is None or self.bay[0] <= u <= self.bay[1])
        return self.right + (BAY_DEPTH if beside_bay else 0)

    def stripes(self) -> NDArray[np.float64]:
        """v of the right edge of each stripe of a crosswalk; a stripe is 0.5 m wide."""
        return np.arange(-self.right + 0.5, self.left - 0.6, 1.0)

    def open(self, side: int, u: float, margin: float = 0.0) -> bool:
        """Whether a gap interrupts this side within `margin` of u."""
        return any(
            gap.side == side and gap.start - margin < u < gap.end + margin for gap in self.gaps
        )


def streets(town: Town) -> tuple[Street, ...]:
    """The main street and, if there is a junction, the side street."""
    left = LANE_WIDTH * town.lanes_ahead
    gaps: list[Gap] = []
    if town.junction:
        side, x, half = town.junction.side, town.junction.x_m, LANE_WIDTH + CORNER_RADIUS
        gaps.append(Gap(1 if side == "left" else -1, x - half, x + half, mouth=True))
    if town.rails_x_m is not None:
        for sign in (-1, 1):
            gaps.append(Gap(sign, town.rails_x_m - 3, town.rails_x_m + 3, mouth=False))
    main = Street(
        name="main",
        origin=(0, 0),
        angle=0,
        curvature=town.curvature_1pm,
        start=START_X,
        end=END_X,
        right=LANE_WIDTH,
        left=left,
        middle=LANE_WIDTH * (town.lanes_ahead - 1),
        bay=town.bus_bay,
        gaps=tuple(gaps),
    )
    if town.junction is None:
        return (main,)
    sign = 1 if town.junction.side == "left" else -1
    side_street = Street(
        name="side",
        origin=(town.junction.x_m, left if sign > 0 else -LANE_WIDTH),
        angle=sign * np.pi / 2,
        curvature=0,
        start=0,
        end=SIDE_LENGTH,
        right=LANE_WIDTH,
        left=LANE_WIDTH,
        middle=0,
        bay=None,
        gaps=(),
    )
    return main, side_street


def on_asphalt(town: Town, x: float, y: float, margin: float = 0.0) -> bool:
    """Whether a point lies on a street, at least `margin` metres from its kerbs."""
    main, *side = streets(town)
    u, v = main.local(x, y)
    if main.start <= u <= main.end and -main.edge(-1, u) + margin <= v <= main.left - margin:
        return True
    for street in side:
        u, v = street.local(x, y)
        if -margin <= u <= street.end and abs(v) <= LANE_WIDTH - margin:
            return True
        # The rounded corners: a square without the disc inside the kerb.
        if -margin <= u <= CORNER_RADIUS and abs(v) <= LANE_WIDTH + CORNER_RADIUS:
            gap = np.hypot(CORNER_RADIUS - u, LANE_WIDTH + CORNER_RADIUS - abs(v))
            return bool(gap >= CORNER_RADIUS + margin)
    return False
