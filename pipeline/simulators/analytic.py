"""A world without a renderer: milliseconds per test and planted failure regions.

For tests of strategies and campaigns (are the regions found? does a campaign resume?), not for
claims about a detector.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.core.braking import Vehicle
from pipeline.core.encounter import Encounter, RoadUsers
from pipeline.core.ground import Pinhole
from pipeline.core.interfaces import Observation
from pipeline.core.paths import Path, Pose
from pipeline.core.space import Value
from pipeline.core.truth import Truth
from pipeline.protocols import Admitted
from pipeline.scenarios.functional import EGO_HALF_LENGTH_M, EGO_HALF_WIDTH_M, FunctionalScenario

WIDTH, HEIGHT, FOCAL_PX = 320, 192, 277.0
"""As the default camera's images, on which the shipped detectors were trained."""
SPEED_MPS, HORIZON_S, FRAME_S = 10.0, 3.0, 0.1
LANE_Y_M = -1.75
HIDDEN_FROM_M, SAFE_SIGHT_M, SHORTEST_SIGHT_M, LATE_SIGHT_M = 27.0, 24.0, 11.0, 3.0
"""Distances to the conflict point. Farther away than the first, the pedestrian is hidden, because
retraining needs frames without one. From the others on it stands out: far from all planted regions,
at the border of one, and inside."""
MARGIN = 0.25
"""Width of the margin around a region, in its half widths. There the pedestrian stands out later,
which gives the search a gradient."""
BACKGROUND, FAINT, BRIGHT = 80, 84, 200
"""Grey levels. A person cannot make out a faint pedestrian (`pipeline.core.visibility.visible`)."""


@dataclass(frozen=True)
class Planted:
    """A box in the space in which the pedestrian stands out too late.

    Attributes:
        name: of the region.
        intervals: lowest and highest number of each variable.
        values: names of each categorical variable.
    """

    name: str
    intervals: Mapping[str, tuple[float, float]]
    values: Mapping[str, tuple[str, ...]]

    def depth(self, concrete: Mapping[str, Value]) -> float:
        """At least 1 inside, 0 at the margin's outer edge, negative beyond it."""
        if any(str(concrete[name]) not in names for name, names in self.values.items()):
            return -1.0
        depths = []
        for name, (low, high) in self.intervals.items():
            outside = max(low - float(concrete[name]), float(concrete[name]) - high, 0.0)
            depths.append(1 - outside / (MARGIN * (high - low) / 2))
        return min(depths)


PLANTED = (
    Planted("fog at night", {"sun_altitude": (-20.0, -4.0), "fog": (55.0, 100.0)}, {}),
    Planted(
        "low sun ahead",
        {"sun_altitude": (0.0, 14.0), "rain": (0.0, 35.0)},
        {"animation": ("crouching", "stumble")},
    ),
    Planted("running in heavy rain", {"rain": (80.0, 100.0), "pedestrian_speed": (2.2, 3.0)}, {}),
)


def planted(concretes: Iterable[Mapping[str, Value]]) -> NDArray[np.int64]:
    """Index in `PLANTED` of the first region of each concrete scenario, -1 for none, (n,)."""
    indices = []
    for concrete in concretes:
        inside = [i for i, region in enumerate(PLANTED) if region.depth(concrete) >= 1]
        indices.append(inside[0] if inside else -1)
    return np.array(indices, dtype=np.int64)


def sight_m(concrete: Mapping[str, Value]) -> float:
    """Distance to the conflict point from which on the pedestrian stands out, metres."""
    depth = max(region.depth(concrete) for region in PLANTED)
    if depth >= 1:
        return LATE_SIGHT_M
    return SAFE_SIGHT_M - (SAFE_SIGHT_M - SHORTEST_SIGHT_M) * max(0.0, depth)


class AnalyticWorld:
    """A straight road and a bright figure on a grey image; see `pipeline.protocols.World`.

    With a detector that sees what a person sees and the default brakes, a test fails exactly inside
    the planted regions. The road is always dry, and the ego follows a demand at once.
    """

    needs: ClassVar[Mapping[str, Admitted]] = dict.fromkeys(
        ("rain", "fog", "sun_altitude", "pedestrian_speed", "animation"), ()
    )
    """The variables that a scenario must have."""
    frame_s = step_s = FRAME_S
    camera = Pinhole(WIDTH, HEIGHT, FOCAL_PX, ahead_m=EGO_HALF_LENGTH_M, above_m=1.0)

    def __init__(
        self, scenario: FunctionalScenario | None = None, vehicle: Vehicle | None = None
    ) -> None:
        """Both arguments are ignored: every test has the same road and ideal brakes."""

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        """Begin a test; see `pipeline.protocols.World.reset`. There is no noise, so no seed."""
        self._sight_m, self._walking_mps = sight_m(concrete), float(concrete["pedestrian_speed"])
        self._time_s, self._speed_mps = 0.0, SPEED_MPS
        self._travelled_m = -SPEED_MPS * HORIZON_S - EGO_HALF_LENGTH_M
        return Encounter(
            path=Path([(0.0, LANE_Y_M), (1.0, LANE_Y_M)]),
            conflict_m=0.0,
            heading=np.pi / 2,
            crosses=True,
            half_length_m=EGO_HALF_LENGTH_M,
            half_width_m=EGO_HALF_WIDTH_M,
        )

    def observe(self) -> Observation:
        """Draw a figure that grows as it comes closer; see `pipeline.protocols.World.observe`."""
        distance = -self._travelled_m - EGO_HALF_LENGTH_M
        image = np.full((HEIGHT, WIDTH, 3), BACKGROUND, np.uint8)
        if distance >= HIDDEN_FROM_M:
            return Observation(image, Truth(), self._users())
        half = int(np.clip(120 / max(distance, 4.0), 2, 24))
        top, left = HEIGHT // 2 - half, WIDTH // 2 - half // 2
        grey = BRIGHT if distance <= self._sight_m else FAINT
        image[top : top + 2 * half, left : left + half] = grey
        box = (float(left), float(top), float(left + half), float(top + 2 * half))
        pixels, contrast = 2 * half * half, float(grey - BACKGROUND)
        return Observation(image, Truth(box, box, pixels, pixels, contrast), self._users())

    def advance(self, seconds: float, acceleration_mps2: float) -> RoadUsers:
        """Move the ego and the pedestrian; see `pipeline.protocols.World.advance`."""
        self._travelled_m += self._speed_mps * seconds
        self._speed_mps = max(0.0, self._speed_mps + acceleration_mps2 * seconds)
        self._time_s = round(self._time_s + seconds, 9)
        return self._users()

    def _users(self) -> RoadUsers:
        walked = (self._time_s - HORIZON_S) * self._walking_mps
        pedestrian = Pose(0.0, LANE_Y_M + walked, np.pi / 2)
        ego = Pose(self._travelled_m, LANE_Y_M, 0.0)
        return RoadUsers(self._time_s, self._travelled_m, ego, self._speed_mps, pedestrian)
