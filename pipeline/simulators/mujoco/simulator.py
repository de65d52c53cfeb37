"""The closed loop: render, detect, brake and advance until the outcome is certain (thesis sections 5.3 to 5.5)."""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.core import kpi
from pipeline.core.braking import EmergencyBrake
from pipeline.core.car import Car
from pipeline.core.detections import Detections
from pipeline.core.episode import Episode, Frame, FrameDetections, KeptFrame
from pipeline.core.footprints import Rectangle
from pipeline.core.ground import Pinhole
from pipeline.core.matching import Matching, match, on_pedestrian
from pipeline.core.paths import Pose
from pipeline.core.signals import TimeStep, box_signals
from pipeline.core.space import Value
from pipeline.core.truth import Truth
from pipeline.errors import SimulationError
from pipeline.protocols import Admitted, Detector
from pipeline.scenarios.functional import (
    EGO_HALF_LENGTH_M,
    EGO_HALF_WIDTH_M,
    TIME_LIMIT_S,
    FunctionalScenario,
)

from . import gait
from .lens import CameraSettings
from .stage import Stage, weather_of
from .world import CAMERA_X_M, CAMERA_Z_M, TIMESTEP_S

PEDESTRIAN_RADIUS_M = 0.25
ALONG = np.sin(np.radians(15))
"""Sine of the angle to the ego's path below which a pedestrian counts as walking along it."""


class MujocoSimulator:
    """Executes concrete scenarios of one functional scenario in a rendered MuJoCo world."""

    needs: ClassVar[Mapping[str, Admitted]] = {
        **dict.fromkeys(("rain", "fog"), (0.0, 100.0)),
        "sun_azimuth": (0.0, 360.0),
        "sun_altitude": (-90.0, 90.0),
        "pedestrian_shift": (-20.0, 20.0),
        "pedestrian_speed": (0.0, 10.0),
        "animation": gait.ANIMATIONS,
        "blueprint": (),
    }
    """The variables that a scenario must have."""
    closed: ClassVar[bool] = True

    def __init__(
        self, scenario: FunctionalScenario, car: Car, camera: CameraSettings | None = None
    ) -> None:
        self._scenario, self._car = scenario, car
        self._settings = camera or CameraSettings()
        self._space = scenario.logical_space()
        self._stage = Stage(scenario.town, scenario.actors, self._settings)

    def execute(
        self,
        concrete: Mapping[str, Value],
        detector: Detector,
        keep_every: int = 0,
        noise: Mapping[str, Value] | None = None,
    ) -> Episode:
        """Execute one concrete scenario; see `pipeline.protocols.Simulator`."""
        own = self._space.decode(self._space.encode(concrete))
        given = own if noise is None else noise
        seeding = {
            **given,
            **{v.name: v.decode(v.encode(given[v.name])) for v in self._space.variables},
        }
        loop = _Loop(self._stage, self._scenario, self._car, own, self._settings)
        return loop.run(detector, keep_every, np.random.default_rng(_seed(seeding)))

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
        return max(
            0.0, footprint.distance(self.pedestrian.x, self.pedestrian.y) - PEDESTRIAN_RADIUS_M
        )


class _Loop:
    """One test execution."""

    def __init__(
        self,
        stage: Stage,
        scenario: FunctionalScenario,
        car: Car,
        concrete: Mapping[str, Value],
        settings: CameraSettings,
    ) -> None:
        self._stage, self._scenario, self._car = stage, scenario, car
        self._speed, self._shift = (
            float(concrete["pedestrian_speed"]),
            float(concrete["pedestrian_shift"]),
        )
        self._rain = float(concrete["rain"])
        self._animation = str(concrete["animation"])
        self._heading = np.radians(scenario.pedestrian.heading_deg)
        self._steps = round(1 / settings.rate_hz / TIMESTEP_S)
        self._time = 0.0
        self._brake, self._demands = EmergencyBrake(car.aeb), _Delayed(car.vehicle.latency_s)
        self._view = Pinhole(
            settings.width, settings.height, stage.camera.focal_px, CAMERA_X_M, CAMERA_Z_M
        )
        self._route, self._conflict = scenario.ego.route(), scenario.conflict_s()
        self._routes = {name: actor.route() for name, actor in scenario.actors.items()}
        # The pedestrian's motion to the ego's left, per metre walked.
        self._across = float(np.sin(self._heading - self._route.at(self._conflict).heading))
        stage.reset(weather_of(concrete), str(concrete["blueprint"]))
        stage.launch(
            scenario.start_s(),
            scenario.ego.speed_kmh / 3.6,
            car.vehicle.full_brake_mps2(self._rain),
            car.vehicle.build_up_s,
        )

    def run(self, detector: Detector, keep_every: int, rng: np.random.Generator) -> Episode:
        steps: list[TimeStep] = []
        kept: list[KeptFrame] = []
        found: list[FrameDetections] = []
        while True:
            state = self._place()
            image, truth = self._stage.shoot(rng)
            frame = Frame(image, truth, self._time)
            detections = detector.detect(frame)
            matching = match(detections, truth, self._car.criterion)
            found.append(FrameDetections(detections, self._in_path(detections, state)))
            if keep_every and len(steps) % keep_every == 0:
                kept.append(KeptFrame(len(steps), frame, detections, matching))
            demand = self._brake.demand(detections, self._followed(found[-1], truth))
            steps.append(self._step(state, truth, matching, demand))
            state = self._drive(demand)
            if self._decided(state):
                break
        return Episode.of([*steps, self._step(state, Truth(), Matching(), 0.0)], kept, found)

    def _followed(self, found: FrameDetections, truth: Truth) -> NDArray[np.bool_]:
        if self._car.aeb.gate == "detections":
            return found.in_path
        return on_pedestrian(found.detections, truth, self._car.criterion)

    def _in_path(self, detections: Detections, state: _State) -> NDArray[np.bool_]:
        """Whether the foot of each box lies on the road ahead that the ego will sweep, (n,)."""
        reach = EGO_HALF_WIDTH_M + self._car.aeb.margin_m
        cos, sin = np.cos(state.ego.heading), np.sin(state.ego.heading)
        inside = np.zeros(len(detections.boxes), bool)
        for i, (ahead, left) in enumerate(self._view.ground(detections.boxes)):
            if np.isfinite(ahead):
                x, y = (
                    state.ego.x + cos * ahead - sin * left,
                    state.ego.y + sin * ahead + cos * left,
                )
                inside[i] = abs(self._route.project(x, y)[1]) <= reach
        return inside

    def _place(self) -> _State:
        """Place the pedestrian and the other road users at the current time."""
        state = self._state()
        scenario, travelled = self._scenario, self._time * self._speed
        if scenario.has_pedestrian:
            walker = self._stage.walker
            phase = gait.phase(travelled, self._speed, walker)
            self._stage.place_pedestrian(
                state.pedestrian, gait.pose(self._animation, phase, self._speed, walker)
            )
        else:
            self._stage.pedestrian.hide()
        self._stage.put("ego", state.ego)
        for name, actor in scenario.actors.items():
            self._stage.put(name, self._routes[name].at(actor.travelled(self._time)))
        return state

    def _state(self) -> _State:
        pedestrian = self._scenario.pedestrian_pose(self._time, self._speed, self._shift)
        travelled = self._stage.travelled
        if not np.isfinite(travelled):
            raise SimulationError(f"the ego's position became {travelled} at {self._time:.2f} s")
        return _State(
            self._time, travelled, self._route.at(travelled), self._stage.ego_speed, pedestrian
        )

    def _drive(self, brake: float) -> _State:
        """Advance to the next camera frame, or to the contact."""
        self._demands.put(self._time, brake)
        for _ in range(self._steps):
            self._stage.step(self._demands.at(self._time))
            self._time = round(self._time + TIMESTEP_S, 9)
            state = self._state()
            if self._touching(state):
                break
        return state

    def _touching(self, state: _State) -> bool:
        return self._scenario.has_pedestrian and state.gap <= 0

    def _on_collision_path(self, state: _State) -> bool:
        """Whether the pedestrian crosses the ego's swept corridor and has not yet left it."""
        if not self._scenario.asks_to_brake:
            return False
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
        crosses = self._scenario.asks_to_brake
        conflict = (
            self._route.project(state.pedestrian.x, state.pedestrian.y)[0]
            if crosses and self._along
            else self._conflict
        )
        return max(0.0, conflict - state.travelled - EGO_HALF_LENGTH_M)

    def _decided(self, state: _State) -> bool:
        stopped = state.ego_speed <= kpi.MIN_SPEED_MPS
        crosses = self._scenario.asks_to_brake
        over = (
            not self._on_collision_path(state) if crosses else self._conflict_distance(state) <= 0
        )
        return self._touching(state) or stopped or over or self._time >= TIME_LIMIT_S

    def _step(self, state: _State, truth: Truth, matching: Matching, demand: float) -> TimeStep:
        here, vehicle = self._scenario.has_pedestrian, self._car.vehicle
        return TimeStep(
            time_s=state.time_s,
            ego_x_m=state.ego.x,
            ego_y_m=state.ego.y,
            ego_heading_deg=float(np.degrees(state.ego.heading)),
            ego_speed_mps=state.ego_speed,
            pedestrian_x_m=state.pedestrian.x if here else np.nan,
            pedestrian_y_m=state.pedestrian.y if here else np.nan,
            conflict_distance_m=self._conflict_distance(state),
            gap_m=state.gap if here else np.nan,
            on_collision_path=self._on_collision_path(state),
            contact=self._touching(state),
            stopping_distance_m=float(vehicle.stopping_distance(state.ego_speed, self._rain)),
            brake=demand,
            demand_mps2=demand * vehicle.full_brake_mps2(rain=0),
            confidence=matching.confidence,
            any_confidence=matching.any_confidence,
            overlap=matching.overlap,
            false_positives=matching.false_positives,
            false_positives_far=matching.far,
            false_positives_localisation=matching.localisation,
            false_positives_duplicate=matching.duplicate,
            visible_pixels=truth.visible_pixels,
            contrast=truth.contrast,
            **box_signals(truth),
        )


class _Delayed:
    """Brake demands that take effect after the latency."""

    def __init__(self, latency_s: float) -> None:
        self._latency = latency_s
        self._waiting: deque[tuple[float, float]] = deque()
        self._in_force = 0.0

    def put(self, time_s: float, demand: float) -> None:
        """Add the demand that the frame at a time causes."""
        self._waiting.append((time_s + self._latency, demand))

    def at(self, time_s: float) -> float:
        """The demand in force at a time; times must not decrease."""
        while self._waiting and self._waiting[0][0] <= time_s + 1e-9:
            self._in_force = self._waiting.popleft()[1]
        return self._in_force


def _seed(concrete: Mapping[str, Value]) -> int:
    """A seed that depends on the concrete scenario alone, so that a replay has the same rain; 0 and 0.0 differ, so decode it first."""
    text = json.dumps(dict(concrete), sort_keys=True)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")
