"""The closed loop: render, detect, brake, move on, until the outcome is decided (thesis sections 5.3 to 5.5)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core import kpi
from pipeline.core.space import Space
from pipeline.protocols import SIGNALS, Detector, Episode, Frame, KeptFrame, SimulationError, Truth, Value
from pipeline.scenario import FunctionalScenario

from . import gait
from .stage import CameraSettings, Stage, weather_of
from .world import TIMESTEP_S

EGO_HALF_LENGTH_M = 2.5
EGO_HALF_WIDTH_M = 0.95
PEDESTRIAN_RADIUS_M = 0.25
TIME_LIMIT_S = 12.0


class MujocoSimulator:
    """Executes concrete scenarios of one functional scenario in a rendered MuJoCo world; one per process."""

    def __init__(self, scenario: Mapping[str, Any], camera: Mapping[str, Any] | None = None) -> None:
        self._scenario = FunctionalScenario.model_validate(scenario)
        self._settings = CameraSettings.model_validate(dict(camera or {}))
        self._space = Space.from_dict(self._scenario.space)
        self._stage = Stage(self._scenario.town, self._scenario.actors, self._settings)

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
    """Where everyone is. Metres, seconds, world frame."""

    time_s: float
    ego_x: float
    ego_y: float
    ego_speed: float
    pedestrian_x: float
    pedestrian_y: float

    @property
    def gap(self) -> float:
        """Distance between the ego's rectangle and the pedestrian's disc, 0 at contact."""
        dx = max(0.0, abs(self.pedestrian_x - self.ego_x) - EGO_HALF_LENGTH_M)
        dy = max(0.0, abs(self.pedestrian_y - self.ego_y) - EGO_HALF_WIDTH_M)
        return max(0.0, float(np.hypot(dx, dy)) - PEDESTRIAN_RADIUS_M)


class _Loop:
    """One test execution."""

    def __init__(self, stage: Stage, scenario: FunctionalScenario, concrete: Mapping[str, Value], rate_hz: float) -> None:
        self._stage, self._scenario = stage, scenario
        self._speed, self._shift = float(concrete["pedestrian_speed"]), float(concrete["pedestrian_shift"])
        self._animation = str(concrete["animation"])
        self._heading = np.radians(scenario.pedestrian.heading_deg)
        self._rng = np.random.default_rng(_seed(concrete))
        self._steps = round(1 / rate_hz / TIMESTEP_S)
        self._rows: dict[str, list[Any]] = {name: [] for name in SIGNALS}
        self._time = 0.0
        ego = scenario.ego
        speed = ego.speed_kmh / 3.6
        stage.reset(weather_of(concrete), str(concrete["blueprint"]))
        stage.place_ego(-speed * ego.horizon_s - EGO_HALF_LENGTH_M, ego.lane_y_m, speed)

    def run(self, detector: Detector, keep_every: int) -> Episode:
        kept: list[KeptFrame] = []
        index = 0
        while True:
            state = self._place()
            image, truth = self._stage.shoot(self._rng)
            frame = Frame(image, truth, self._time)
            detections = detector.detect(frame)
            matching = kpi.match(
                detections.boxes, detections.scores, truth.visible_box, truth.whole_box, truth.visible_pixels, truth.contrast
            )
            self._record(state, truth, matching)
            if keep_every and index % keep_every == 0:
                kept.append(KeptFrame(index, frame, detections))
            state = self._drive(matching.confidence)
            index += 1
            if self._decided(state):
                break
        self._record(state, Truth(), kpi.Matching((), 0.0))
        signals: dict[str, NDArray[Any]] = {name: np.array(column, dtype=SIGNALS[name]) for name, column in self._rows.items()}
        signals["ttc_s"] = kpi.ttc(signals)
        return Episode(signals, tuple(kept))

    def _place(self) -> _State:
        """Put the pedestrian and the other road users where they are at the present time."""
        state = self._state()
        scenario, travelled = self._scenario, self._time * self._speed
        phase = gait.phase(travelled, self._speed)
        heading = scenario.pedestrian.heading_deg
        self._stage.place_pedestrian(state.pedestrian_x, state.pedestrian_y, heading, self._animation, phase, self._speed)
        for name, actor in scenario.actors.items():
            driven, direction = self._time * actor.speed_kmh / 3.6, np.radians(actor.heading_deg)
            self._stage.place_actor(name, actor.x_m + driven * np.cos(direction), actor.y_m + driven * np.sin(direction), actor.heading_deg)
        return state

    def _state(self) -> _State:
        ego = self._scenario.ego
        # Unbraked, ego's front and pedestrian reach the conflict point together at horizon_s; the shift then moves the pedestrian.
        along = (self._time - ego.horizon_s) * self._speed + self._shift
        x, y = along * np.cos(self._heading), ego.lane_y_m + along * np.sin(self._heading)
        state = _State(self._time, self._stage.ego_x, ego.lane_y_m, self._stage.ego_speed, float(x), float(y))
        if not np.isfinite(state.ego_x):
            raise SimulationError(f"the ego's position became {state.ego_x} at {self._time:.2f} s")
        return state

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
        across = np.sign(np.round(np.sin(self._heading), 9))
        return bool(across * (state.pedestrian_y - state.ego_y) <= EGO_HALF_WIDTH_M + PEDESTRIAN_RADIUS_M)

    def _decided(self, state: _State) -> bool:
        stopped = state.ego_speed <= kpi.MIN_SPEED_MPS
        return state.gap <= 0 or stopped or not self._on_collision_path(state) or self._time >= TIME_LIMIT_S

    def _record(self, state: _State, truth: Truth, matching: kpi.Matching) -> None:
        row = {
            "time_s": state.time_s,
            "ego_x_m": state.ego_x,
            "ego_y_m": state.ego_y,
            "ego_speed_mps": state.ego_speed,
            "pedestrian_x_m": state.pedestrian_x,
            "pedestrian_y_m": state.pedestrian_y,
            "conflict_distance_m": max(0.0, -state.ego_x - EGO_HALF_LENGTH_M),
            "gap_m": state.gap,
            "on_collision_path": self._on_collision_path(state),
            "contact": state.gap <= 0,
            "brake": matching.confidence,
            "confidence": matching.confidence,
            "ttc_s": np.nan,
            "false_positives": matching.false_positives,
            "false_positives_far": matching.far,
            "false_positives_localisation": matching.localisation,
            "false_positives_duplicate": matching.duplicate,
            "visible_pixels": truth.visible_pixels,
            "contrast": truth.contrast,
        }
        for name, value in row.items():
            self._rows[name].append(value)


def _seed(concrete: Mapping[str, Value]) -> int:
    """A seed that depends on the concrete scenario alone, so that a replay sees the same rain."""
    text = json.dumps(dict(concrete), sort_keys=True)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")
