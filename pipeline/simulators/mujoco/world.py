"""The rendered world: what the camera sees and how the road users move. It judges nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from pipeline.core.braking import Vehicle
from pipeline.core.encounter import Encounter, RoadUsers
from pipeline.core.ground import Pinhole
from pipeline.core.interfaces import Observation
from pipeline.core.space import Value
from pipeline.protocols import Admitted
from pipeline.scenarios.functional import FunctionalScenario
from pipeline.simulators.mujoco import gait
from pipeline.simulators.mujoco.lens import CameraSettings
from pipeline.simulators.mujoco.model import CAMERA_X_M, CAMERA_Z_M, TIMESTEP_S
from pipeline.simulators.mujoco.stage import Stage, weather_of


class MujocoWorld:
    """One functional scenario in MuJoCo; see `pipeline.protocols.World`."""

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
        self,
        scenario: FunctionalScenario,
        vehicle: Vehicle,
        camera: CameraSettings | None = None,
    ) -> None:
        settings = camera or CameraSettings()
        self._scenario, self._vehicle = scenario, vehicle
        self._stage = Stage(scenario.town, scenario.actors, settings)
        self._route = scenario.ego.route()
        self._actors = {name: (actor, actor.route()) for name, actor in scenario.actors.items()}
        self.frame_s, self.step_s = 1 / settings.rate_hz, TIMESTEP_S
        self.camera = Pinhole(
            settings.width, settings.height, self._stage.camera.focal_px, CAMERA_X_M, CAMERA_Z_M
        )

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        """Begin a test; see `pipeline.protocols.World.reset`."""
        self._time_s, self._rng = 0.0, np.random.default_rng(seed)
        self._speed_mps = float(concrete["pedestrian_speed"])
        self._shift_m = float(concrete["pedestrian_shift"])
        self._animation = str(concrete["animation"])
        rain = float(concrete["rain"])
        self._full_brake_mps2 = self._vehicle.full_brake_mps2(rain)
        self._stage.reset(weather_of(concrete), str(concrete["blueprint"]))
        self._stage.launch(
            self._scenario.start_s(),
            self._scenario.ego.speed_kmh / 3.6,
            self._full_brake_mps2,
            self._vehicle.build_up_s,
        )
        return self._scenario.encounter(rain)

    def observe(self) -> Observation:
        """Render the present state; see `pipeline.protocols.World.observe`."""
        users, stage = self._users(), self._stage
        if users.pedestrian is None:
            stage.pedestrian.hide()
        else:
            phase = gait.phase(self._time_s * self._speed_mps, self._speed_mps, stage.walker)
            posture = gait.pose(self._animation, phase, self._speed_mps, stage.walker)
            stage.place_pedestrian(users.pedestrian, posture)
        stage.put("ego", users.ego)
        for name, (actor, route) in self._actors.items():
            stage.put(name, route.at(actor.travelled(self._time_s)))
        image, truth = stage.shoot(self._rng)
        return Observation(image, truth, users)

    def advance(self, seconds: float, acceleration_mps2: float) -> RoadUsers:
        """Advance by one time step of MuJoCo; see `pipeline.protocols.World.advance`."""
        if acceleration_mps2 > 0:  # The engine, unlike the brake, gives as much on a wet road.
            demand = -acceleration_mps2 / self._full_brake_mps2
        else:
            # A brake demand is a score, with single precision: this gives back the same number.
            demand = float(np.float32(-acceleration_mps2 / self._vehicle.full_brake_mps2(0)))
        self._stage.step(demand)
        self._time_s = round(self._time_s + seconds, 9)
        return self._users()

    def close(self) -> None:
        """Free the GL context."""
        self._stage.close()

    def _users(self) -> RoadUsers:
        travelled, pedestrian = self._stage.travelled, None
        if self._scenario.has_pedestrian:
            pedestrian = self._scenario.pedestrian_pose(
                self._time_s, self._speed_mps, self._shift_m
            )
        ego = self._route.at(travelled)
        return RoadUsers(self._time_s, travelled, ego, self._stage.ego_speed, pedestrian)
