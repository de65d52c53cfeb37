"""A compiled world with its camera; episodes and random scenes place the road users on it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pipeline.core.paths import Pose
from pipeline.core.truth import Truth
from pipeline.scenarios.functional import Actor
from pipeline.scenarios.people import Blueprint, person
from pipeline.scenarios.streets import Town
from pipeline.simulators.mujoco import gait, model
from pipeline.simulators.mujoco.camera import Camera
from pipeline.simulators.mujoco.furniture import lamp_positions
from pipeline.simulators.mujoco.lens import CameraSettings
from pipeline.simulators.mujoco.pedestrian import Pedestrian
from pipeline.simulators.mujoco.weather import Weather


class Stage:
    """One world in this process. Poses: metres and radians in the world frame (x ahead, y left).

    walker: the person shown as the pedestrian in this episode.
    """

    walker: Blueprint

    def __init__(self, town: Town, actors: Mapping[str, Actor], settings: CameraSettings) -> None:
        self.model = model.describe(
            town, actors, settings.vfov_deg, settings.width, settings.height
        ).compile()
        self.data = mujoco.MjData(self.model)
        self.pedestrian = Pedestrian(self.model, self.data)
        self.camera = Camera(self.model, self.data, lamp_positions(town), settings)
        self._travelled = self.model.joint("ego_travelled")
        self._mocap = {name: int(self.model.body(name).mocapid[0]) for name in ("ego", *actors)}

    def reset(self, weather: Weather, blueprint: str) -> None:
        """Begin an episode: everything at rest, the pedestrian dressed as the named person."""
        mujoco.mj_resetData(self.model, self.data)
        self.walker = person(blueprint)
        self.pedestrian.dress(self.walker)
        self.camera.set_weather(weather)

    def launch(
        self, travelled_m: float, speed_mps: float, full_brake_mps2: float, build_up_s: float
    ) -> None:
        """Start the ego at a speed, at a distance in metres along its route.

        Its brake gives `full_brake_mps2` behind a first-order lag.
        """
        brake = self.model.actuator("brake")
        brake.gainprm[0], brake.dynprm[0] = (
            -model.EGO_MASS_KG * full_brake_mps2,
            max(build_up_s, model.TIMESTEP_S),
        )
        self.data.qpos[self._travelled.qposadr[0]] = travelled_m
        self.data.qvel[self._travelled.dofadr[0]] = speed_mps

    @property
    def travelled(self) -> float:
        """Metres along the ego's route."""
        return float(self.data.qpos[self._travelled.qposadr[0]])

    @property
    def ego_speed(self) -> float:
        return float(self.data.qvel[self._travelled.dofadr[0]])

    def step(self, brake: float) -> None:
        """Advance the ego by one timestep under a brake demand in [0, 1], or below 0 to drive.

        A negative speed is set to zero only after the step, so a stopped ego creeps back while the
        brake is held: 24 mm in 120 steps at 8 m/s2.
        """
        self.data.ctrl[0] = brake
        mujoco.mj_step(self.model, self.data)
        dof = self._travelled.dofadr[0]
        if self.data.qvel[dof] < 0:
            self.data.qvel[dof] = 0.0

    def put(self, name: str, pose: Pose) -> None:
        """Put the middle of a vehicle, an actor's name or "ego", at a pose."""
        i, half = self._mocap[name], pose.heading / 2
        self.data.mocap_pos[i] = (pose.x, pose.y, 0)
        self.data.mocap_quat[i] = (np.cos(half), 0, 0, np.sin(half))

    def place_pedestrian(self, where: Pose, posture: gait.Posture) -> None:
        """Put the pedestrian at a pose in the world, its joints posed by the gait."""
        self.pedestrian.place(where.x, where.y, where.heading, posture)

    def shoot(self, rng: np.random.Generator) -> tuple[NDArray[np.uint8], Truth]:
        """Render the present state; see `Camera.shoot`."""
        return self.camera.shoot(rng)

    def close(self) -> None:
        self.camera.close()


def weather_of(concrete: Mapping[str, Any]) -> Weather:
    """The weather of a concrete scenario."""
    return Weather(
        *(float(concrete[name]) for name in ("rain", "fog", "sun_azimuth", "sun_altitude"))
    )
