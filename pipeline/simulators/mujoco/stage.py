"""A compiled world with its camera, on which episodes and random scenes place the ego, the pedestrian and the other road users."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from pipeline.protocols import Truth
from pipeline.scenario import Actor, Town

from . import gait, world
from .blueprints import BLUEPRINTS
from .camera import Camera
from .pedestrian import Pedestrian
from .town import lamp_positions
from .weather import Weather


class CameraSettings(BaseModel):
    """Image size in pixels, horizontal field of view in degrees, frames a second."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    width: int = Field(default=320, ge=64, le=1920, multiple_of=32)
    height: int = Field(default=192, ge=64, le=1088, multiple_of=32)
    hfov_deg: float = Field(default=60, ge=20, le=120)
    rate_hz: float = Field(default=10, ge=2, le=50)

    @property
    def vfov_deg(self) -> float:
        return float(2 * np.degrees(np.arctan(np.tan(np.radians(self.hfov_deg / 2)) * self.height / self.width)))


class Stage:
    """One world in this process. Poses: metres and degrees in the world frame (x ahead, y left)."""

    def __init__(self, town: Town, actors: Mapping[str, Actor], settings: CameraSettings) -> None:
        self.model = world.build(town, actors, settings.vfov_deg, settings.width, settings.height)
        self.data = mujoco.MjData(self.model)
        self.pedestrian = Pedestrian(self.model, self.data)
        self.camera = Camera(self.model, self.data, lamp_positions(town), settings.width, settings.height)
        self._ego_body = self.model.body("ego").id
        self._ego_x = self.model.joint("ego_x")
        self._mocap = {name: int(self.model.body(name).mocapid[0]) for name in actors}

    def reset(self, weather: Weather, blueprint: str) -> None:
        """Begin a new episode: everything at rest, the pedestrian dressed, the weather set."""
        mujoco.mj_resetData(self.model, self.data)
        self.pedestrian.dress(BLUEPRINTS[blueprint])
        self.camera.set_weather(weather)

    def place_ego(self, x: float, y: float, speed_mps: float = 0.0) -> None:
        self.model.body_pos[self._ego_body, 1] = y
        self.data.qpos[self._ego_x.qposadr[0]] = x
        self.data.qvel[self._ego_x.dofadr[0]] = speed_mps

    @property
    def ego_x(self) -> float:
        return float(self.data.qpos[self._ego_x.qposadr[0]])

    @property
    def ego_speed(self) -> float:
        return float(self.data.qvel[self._ego_x.dofadr[0]])

    def step(self, brake: float) -> None:
        """Advance the ego by one timestep under a brake demand in [0, 1]; it stops, it does not roll back."""
        self.data.ctrl[0] = brake
        mujoco.mj_step(self.model, self.data)
        dof = self._ego_x.dofadr[0]
        if self.data.qvel[dof] < 0:
            self.data.qvel[dof] = 0.0

    def place_actor(self, name: str, x: float, y: float, heading_deg: float) -> None:
        i, half = self._mocap[name], np.radians(heading_deg) / 2
        self.data.mocap_pos[i] = (x, y, 0)
        self.data.mocap_quat[i] = (np.cos(half), 0, 0, np.sin(half))

    def place_pedestrian(self, x: float, y: float, heading_deg: float, animation: str, phase_rad: float, speed_mps: float) -> None:
        self.pedestrian.place(x, y, float(np.radians(heading_deg)), gait.pose(animation, phase_rad, speed_mps))

    def shoot(self, rng: np.random.Generator) -> tuple[NDArray[np.uint8], Truth]:
        """Render the present state; see `Camera.shoot`."""
        return self.camera.shoot(rng)

    def close(self) -> None:
        self.camera.close()


def weather_of(concrete: Mapping[str, Any]) -> Weather:
    """The weather of a concrete scenario."""
    return Weather(*(float(concrete[name]) for name in ("rain", "fog", "sun_azimuth", "sun_altitude")))
