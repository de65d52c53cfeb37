"""A stand-in for a simulator: milliseconds per test and planted, hence known, failure regions.

For tests of strategies and campaigns (are the regions found? does a campaign resume?), not for claims about a detector.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.core import kpi
from pipeline.core.car import Car
from pipeline.core.detections import Detections
from pipeline.core.episode import Episode, Frame, FrameDetections, KeptFrame
from pipeline.core.matching import match
from pipeline.core.signals import SIGNALS, TimeStep, box_signals
from pipeline.core.space import Floats, Value
from pipeline.core.truth import Truth
from pipeline.protocols import Admitted, Detector
from pipeline.scenarios.functional import EGO_HALF_LENGTH_M, FunctionalScenario

WIDTH, HEIGHT = 320, 192
"""As the default camera's images, on which the shipped detectors were trained."""
SPEED_MPS, HORIZON_S, STEP_S, BRAKE_MPS2 = 10.0, 3.0, 0.1, 8.0
SAFE_DETECTION_M = 24.0
HIDDEN_FROM_M = 27.0
"""Distance from which the pedestrian is hidden: retraining needs frames without one, too."""
MARGIN = 0.25
"""Width of the margin around a region, in its half widths, in which detection is late: it gives the search a gradient."""

_ZEROS: dict[str, Any] = dict.fromkeys((signal.name for signal in SIGNALS), 0)
NOTHING = TimeStep(**_ZEROS)
"""A time step at which every signal is 0."""


@dataclass(frozen=True)
class Planted:
    """A box in the space in which detection comes too late. intervals: variable -> (low, high); values: variable -> admitted names."""

    name: str
    intervals: Mapping[str, tuple[float, float]]
    values: Mapping[str, tuple[str, ...]]


PLANTED = (
    Planted("fog at night", {"sun_altitude": (-20.0, -4.0), "fog": (55.0, 100.0)}, {}),
    Planted(
        "low sun ahead",
        {"sun_altitude": (0.0, 14.0), "rain": (0.0, 35.0)},
        {"animation": ("crouching", "stumble")},
    ),
    Planted("running in heavy rain", {"rain": (80.0, 100.0), "pedestrian_speed": (2.2, 3.0)}, {}),
)


class AnalyticSimulator:
    """Executes concrete scenarios by formula. The detector gets a simple image, but the outcome depends on the point alone."""

    needs: ClassVar[Mapping[str, Admitted]] = dict.fromkeys(
        ("rain", "fog", "sun_altitude", "pedestrian_speed", "animation"), ()
    )
    """The variables that a scenario must have."""

    def __init__(self, scenario: FunctionalScenario, car: Car) -> None:
        self._space, self._car = scenario.logical_space(), car

    def planted(self, points: Floats) -> NDArray[np.int64]:
        """Index in `PLANTED` of each point's region (n, d), -1 for none, as (n,)."""
        concretes = [self._space.decode(point) for point in points]
        return np.array(
            [
                next((i for i, region in enumerate(PLANTED) if _depth(region, c) >= 1), -1)
                for c in concretes
            ],
            dtype=np.int64,
        )

    def execute(
        self,
        concrete: Mapping[str, Value],
        detector: Detector,
        keep_every: int = 0,
        noise: Mapping[str, Value] | None = None,
    ) -> Episode:
        """Execute one concrete scenario; see `pipeline.protocols.Simulator`. It fails exactly inside the planted regions, without noise."""
        self._space.encode(concrete)
        depth = max(_depth(region, concrete) for region in PLANTED)
        # Across the margin, the detection distance falls from safe to too short.
        sees_at = 0.0 if depth >= 1 else SAFE_DETECTION_M - 13 * max(0.0, depth)
        steps: list[TimeStep] = []
        kept: list[KeptFrame] = []
        found: list[FrameDetections] = []
        distance, speed, time = SPEED_MPS * HORIZON_S, SPEED_MPS, 0.0
        while True:
            frame = _frame(distance, time)
            braking = distance <= sees_at
            detections = detector.detect(frame) if braking else Detections.none()
            if keep_every and len(steps) % keep_every == 0:
                kept.append(
                    KeptFrame(
                        len(steps),
                        frame,
                        detections,
                        match(detections, frame.truth, self._car.criterion),
                    )
                )
            found.append(FrameDetections(detections, np.zeros(len(detections.boxes), bool)))
            walked = (time - HORIZON_S) * float(concrete["pedestrian_speed"])
            steps.append(_step(frame, distance, speed, braking, walked))
            if distance <= 0 or speed <= kpi.MIN_SPEED_MPS:
                return Episode.of(steps, kept, found)
            distance = max(0.0, distance - speed * STEP_S)
            speed = max(0.0, speed - (BRAKE_MPS2 * STEP_S if braking else 0.0))
            time = round(time + STEP_S, 9)


def _depth(region: Planted, concrete: Mapping[str, Value]) -> float:
    """Depth in a region: 1 or more inside, falling to 0 at the outer edge of its margin, negative beyond; -1 if a category does not
    match."""
    if any(str(concrete[name]) not in names for name, names in region.values.items()):
        return -1.0
    depths = []
    for name, (low, high) in region.intervals.items():
        outside = max(low - float(concrete[name]), float(concrete[name]) - high, 0.0)
        depths.append(1 - outside / (MARGIN * (high - low) / 2))
    return min(depths)


def _frame(distance: float, time: float) -> Frame:
    """Draw a bright figure that grows as it comes closer."""
    image = np.full((HEIGHT, WIDTH, 3), 80, np.uint8)
    if distance >= HIDDEN_FROM_M:
        return Frame(image, Truth(), time)
    half = int(np.clip(120 / max(distance, 4.0), 2, 24))
    top, left = HEIGHT // 2 - half, WIDTH // 2 - half // 2
    image[top : top + 2 * half, left : left + half] = 200
    box = (float(left), float(top), float(left + half), float(top + 2 * half))
    return Frame(image, Truth(box, box, 2 * half * half, 2 * half * half, 120.0), time)


def _step(frame: Frame, distance: float, speed: float, braking: bool, walked: float) -> TimeStep:
    """distance: metres to the conflict point. walked: metres of the pedestrian past it."""
    boxes: Mapping[str, Any] = box_signals(frame.truth)
    return replace(
        NOTHING,
        time_s=frame.time_s,
        ego_x_m=-distance - EGO_HALF_LENGTH_M,
        ego_y_m=-1.75,
        ego_speed_mps=speed,
        pedestrian_y_m=-1.75 + walked,
        conflict_distance_m=distance,
        gap_m=0.0 if distance <= 0 else distance + 0.1,
        on_collision_path=True,
        contact=distance <= 0,
        stopping_distance_m=speed**2 / (2 * BRAKE_MPS2),
        brake=float(braking),
        demand_mps2=BRAKE_MPS2 * braking,
        confidence=float(braking),
        any_confidence=float(braking),
        overlap=float(braking),
        visible_pixels=frame.truth.visible_pixels,
        contrast=frame.truth.contrast,
        **boxes,
    )
