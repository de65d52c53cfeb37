"""The closed loop: observe, detect, judge, brake and advance until the outcome is certain.

Thesis sections 5.3 to 5.5.
"""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Mapping

import numpy as np

from pipeline.core.braking import CruiseControl
from pipeline.core.car import Car
from pipeline.core.encounter import Encounter, RoadUsers, Situation
from pipeline.core.episode import Episode, Frame, FrameDetections, KeptFrame
from pipeline.core.interfaces import Detector, World
from pipeline.core.judge import Judge, Judged
from pipeline.core.signals import TimeStep, box_signals
from pipeline.core.truth import Truth
from pipeline.core.variable import Value


def run_test(
    world: World,
    detector: Detector,
    car: Car,
    concrete: Mapping[str, Value],
    *,
    keep_every: int = 0,
    noise: Mapping[str, Value] | None = None,
) -> Episode:
    """Execute one concrete scenario in closed loop.

    Args:
        world: renders and moves.
        detector: the system under test.
        car: when a detection counts, when the car brakes and how well.
        concrete: a value for each variable of the scenario.
        keep_every: keep every n-th frame; 0 keeps none.
        noise: scenario that seeds the random noise; None means `concrete`. Further keys change it.

    Returns:
        The signals of each time step, the kept frames and all detections.

    Raises:
        SimulationError: if the world or the detector cannot go on.

    >>> from pipeline.detectors.scripted import BlindDetector, VisiblePixelOracle
    >>> from pipeline.simulators.analytic import AnalyticWorld
    >>> from pipeline.testing import CAR
    >>> weather = {"rain": 0.0, "fog": 10.0, "sun_altitude": 45.0}
    >>> concrete = {**weather, "pedestrian_speed": 1.5, "animation": "walking"}
    >>> for detector in (VisiblePixelOracle(), BlindDetector()):
    ...     episode = run_test(AnalyticWorld(), detector, CAR, concrete)
    ...     print(bool(episode.signals["contact"].any()))
    False
    True
    """
    encounter = world.reset(concrete, seed_of(concrete if noise is None else noise))
    judge, demands = Judge(car), _Delayed(car.vehicle.latency_s)
    steps: list[TimeStep] = []
    kept: list[KeptFrame] = []
    detected: list[FrameDetections] = []
    seen = world.observe()
    situation = encounter.situation(seen.users)
    cruise = CruiseControl(car.vehicle, seen.users.ego_speed_mps)
    while True:
        frame = Frame(seen.image, seen.truth, seen.users.time_s)
        detections = detector.detect(frame)
        feet = world.camera.ground(detections.boxes)
        in_path = encounter.in_path(feet, seen.users.ego, car.aeb.margin_m)
        judged = judge.frame(detections, seen.truth, in_path)
        if keep_every and len(steps) % keep_every == 0:
            kept.append(KeptFrame(len(steps), frame, detections, judged.matching))
        detected.append(FrameDetections(detections, in_path))
        stopping_m = car.vehicle.stopping_distance(seen.users.ego_speed_mps, encounter.rain)
        steps.append(_step(seen.users, situation, float(stopping_m), seen.truth, judged))
        demands.put(seen.users.time_s, judged.demand_mps2)
        users = _advance(world, encounter, seen.users, demands, cruise)
        situation = encounter.situation(users)
        if situation.is_over:
            break
        seen = world.observe()
    stopping_m = car.vehicle.stopping_distance(users.ego_speed_mps, encounter.rain)
    steps.append(_step(users, situation, float(stopping_m), Truth(), Judged()))
    return Episode.of(steps, kept, detected)


def seed_of(concrete: Mapping[str, Value]) -> int:
    """A seed in [0, 2⁶⁴) that depends on the values alone, so that a replay has the same noise.

    >>> seed_of({"rain": 1, "fog": 0}) == seed_of({"fog": 0.0, "rain": 1.0})
    True
    """
    values = {
        name: value if isinstance(value, str) else float(value) for name, value in concrete.items()
    }
    text = json.dumps(values, sort_keys=True)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def _advance(
    world: World, encounter: Encounter, users: RoadUsers, demands: _Delayed, cruise: CruiseControl
) -> RoadUsers:
    """Advance to the next frame, or to the contact."""
    for _ in range(round(world.frame_s / world.step_s)):
        brake_mps2 = demands.at(users.time_s)
        demand_mps2 = cruise.demand(users.ego_speed_mps, brake_mps2, world.step_s)
        users = world.advance(world.step_s, demand_mps2)
        if encounter.gap_m(users) <= 0:
            break
    return users


def _step(
    users: RoadUsers, situation: Situation, stopping_m: float, truth: Truth, judged: Judged
) -> TimeStep:
    pedestrian = users.pedestrian
    return TimeStep(
        time_s=users.time_s,
        ego_x_m=users.ego.x,
        ego_y_m=users.ego.y,
        ego_heading_deg=float(np.degrees(users.ego.heading)),
        ego_speed_mps=users.ego_speed_mps,
        pedestrian_x_m=np.nan if pedestrian is None else pedestrian.x,
        pedestrian_y_m=np.nan if pedestrian is None else pedestrian.y,
        conflict_distance_m=situation.conflict_distance_m,
        gap_m=situation.gap_m,
        on_collision_path=situation.on_collision_path,
        contact=situation.contact,
        stopping_distance_m=stopping_m,
        visible_pixels=truth.visible_pixels,
        contrast=truth.contrast,
        **judged.signals(),
        **box_signals(truth),
    )


class _Delayed:
    """Demands that take effect after the car's latency."""

    def __init__(self, latency_s: float) -> None:
        self._latency_s = latency_s
        self._waiting: deque[tuple[float, float]] = deque()
        self._in_force = 0.0

    def put(self, time_s: float, demand: float) -> None:
        """Add the demand that the frame at a time causes."""
        self._waiting.append((time_s + self._latency_s, demand))

    def at(self, time_s: float) -> float:
        """The demand in force at a time; times must not decrease."""
        while self._waiting and self._waiting[0][0] <= time_s + 1e-9:
            self._in_force = self._waiting.popleft()[1]
        return self._in_force
