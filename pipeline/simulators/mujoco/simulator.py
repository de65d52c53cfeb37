"""The closed loop: render, detect, brake and advance until the outcome is certain (thesis sections 5.3 to 5.5)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.core import kpi
from pipeline.core.episode import Episode, Frame, KeptFrame
from pipeline.core.footprints import Rectangle
from pipeline.core.matching import Matching, match
from pipeline.core.paths import Pose
from pipeline.core.signals import TimeStep
from pipeline.core.space import Value
from pipeline.core.truth import Truth
from pipeline.errors import SimulationError
from pipeline.protocols import Detector
from pipeline.scenarios.functional import EGO_HALF_LENGTH_M, EGO_HALF_WIDTH_M, FunctionalScenario

from . import gait
from .lens import CameraSettings
from .stage import Stage, weather_of
from .world import TIMESTEP_S

PEDESTRIAN_RADIUS_M = 0.25
TIME_LIMIT_S = 12.0
ALONG = np.sin(np.radians(15))
"""Sine of the angle to the ego's path below which a pedestrian counts as walking along it."""


class MujocoSimulator:
    """Executes concrete scenarios of one functional scenario in a rendered MuJoCo world."""

    def __init__(self, scenario: FunctionalScenario, camera: Mapping[str, Any] | None = None) -> None:
        self._scenario = scenario
        self._settings = CameraSettings.model_validate(dict(camera or {}))
        self._space = scenario.logical_space()
        self._stage = Stage(scenario.town, scenario.actors, self._settings)

    def execute(self, concrete: Mapping[str, Value], detector: Detector, keep_every: int = 0) -> Episode:
        """Execute one concrete scenario; see `pipeline.protocols.Simulator`."""
        self._space.encode(concrete)
        loop = _Loop(self._stage, self._scenario, concrete, self._settings.rate_hz)
        return loop.run(detector, keep_every)

    def close(self) -> None:
        """Free the GL context."""
        self._stage.close()


@dataclass(frozen=True)
class _State:
    """Positions of all road users. Metres, seconds, world frame."""

    time_s: float
    travelled: float
    ego: Pose
    ego_speed: float
    pedestrian: Pose

    @property
    def gap(self) -> float:
        """Distance between the ego's rectangle and the pedestrian's disc, 0 at contact."""
        footprint = Rectangle(self.ego, EGO_HALF_LENGTH_M, EGO_HALF_WIDTH_M)
        return max(0.0, footprint.distance(self.pedestrian.x, self.pedestrian.y) - PEDESTRIAN_RADIUS_M)


class _Loop:
    """One test execution."""

    def __init__(self, stage: Stage, scenario: FunctionalScenario, concrete: Mapping[str, Value], rate_hz: float) -> None:
        self._stage, self._scenario = stage, scenario
        self._speed, self._shift = float(concrete["pedestrian_speed"]), float(concrete["pedestrian_shift"])
        self._animation = str(concrete["animation"])
        self._heading = np.radians(scenario.pedestrian.heading_deg)
        self._rng = np.random.default_rng(_seed(concrete))
        self._steps = round(1 / rate_hz / TIMESTEP_S)
        self._time = 0.0
        self._route, self._conflict = scenario.ego.route(), scenario.conflict_s()
        self._routes = {name: actor.route() for name, actor in scenario.actors.items()}
        # The pedestrian's motion to the ego's left, per metre walked.
        self._across = float(np.sin(self._heading - self._route.at(self._conflict).heading))
        stage.reset(weather_of(concrete), str(concrete["blueprint"]))
        stage.launch(scenario.start_s(), scenario.ego.speed_kmh / 3.6)

    def run(self, detector: Detector, keep_every: int) -> Episode:
        steps: list[TimeStep] = []
        kept: list[KeptFrame] = []
        while True:
            state = self._place()
            image, truth = self._stage.shoot(self._rng)
            frame = Frame(image, truth, self._time)
            detections = detector.detect(frame)
            matching = match(detections, truth)
            if keep_every and len(steps) % keep_every == 0:
                kept.append(KeptFrame(len(steps), frame, detections, matching))
            steps.append(self._step(state, truth, matching))
            state = self._drive(matching.confidence)
            if self._decided(state):
                break
        return Episode.of([*steps, self._step(state, Truth(), Matching())], kept)

    def _place(self) -> _State:
        """Place the pedestrian and the other road users at the current time."""
        state = self._state()
        scenario, travelled = self._scenario, self._time * self._speed
        self._stage.place_pedestrian(state.pedestrian, gait.pose(self._animation, gait.phase(travelled, self._speed), self._speed))
        self._stage.put("ego", state.ego)
        for name, actor in scenario.actors.items():
            self._stage.put(name, self._routes[name].at(actor.travelled(self._time)))
        return state

    def _state(self) -> _State:
        pedestrian = self._scenario.pedestrian_pose(self._time, self._speed, self._shift)
        travelled = self._stage.travelled
        if not np.isfinite(travelled):
            raise SimulationError(f"the ego's position became {travelled} at {self._time:.2f} s")
        return _State(self._time, travelled, self._route.at(travelled), self._stage.ego_speed, pedestrian)

    def _drive(self, brake: float) -> _State:
        """Advance to the next camera frame, or to the contact."""
        for _ in range(self._steps):
            self._stage.step(brake)
            self._time = round(self._time + TIMESTEP_S, 9)
            state = self._state()
            if state.gap <= 0:
                break
        return state

    def _on_collision_path(self, state: _State) -> bool:
        """Whether the pedestrian has not yet left the ego's swept corridor."""
        if self._along:
            return True
        left = self._route.project(state.pedestrian.x, state.pedestrian.y)[1]
        return bool(np.sign(self._across) * left <= EGO_HALF_WIDTH_M + PEDESTRIAN_RADIUS_M)

    @property
    def _along(self) -> bool:
        """Whether the pedestrian walks along the ego's path instead of across it."""
        return bool(abs(self._across) < ALONG)

    def _conflict_distance(self, state: _State) -> float:
        """Metres from the ego's front to the conflict point; for a pedestrian who walks along the path, this is the pedestrian."""
        conflict = self._route.project(state.pedestrian.x, state.pedestrian.y)[0] if self._along else self._conflict
        return max(0.0, conflict - state.travelled - EGO_HALF_LENGTH_M)

    def _decided(self, state: _State) -> bool:
        stopped = state.ego_speed <= kpi.MIN_SPEED_MPS
        return state.gap <= 0 or stopped or not self._on_collision_path(state) or self._time >= TIME_LIMIT_S

    def _step(self, state: _State, truth: Truth, matching: Matching) -> TimeStep:
        return TimeStep(
            time_s=state.time_s,
            ego_x_m=state.ego.x,
            ego_y_m=state.ego.y,
            ego_heading_deg=float(np.degrees(state.ego.heading)),
            ego_speed_mps=state.ego_speed,
            pedestrian_x_m=state.pedestrian.x,
            pedestrian_y_m=state.pedestrian.y,
            conflict_distance_m=self._conflict_distance(state),
            gap_m=state.gap,
            on_collision_path=self._on_collision_path(state),
            contact=state.gap <= 0,
            brake=matching.confidence,
            confidence=matching.confidence,
            false_positives=matching.false_positives,
            false_positives_far=matching.far,
            false_positives_localisation=matching.localisation,
            false_positives_duplicate=matching.duplicate,
            visible_pixels=truth.visible_pixels,
            contrast=truth.contrast,
        )


def _seed(concrete: Mapping[str, Value]) -> int:
    """A seed that depends on the concrete scenario alone, so that a replay has the same rain."""
    text = json.dumps(dict(concrete), sort_keys=True)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")
