"""Standing feet do not slide, and a pedestrian at speed 0 stands still."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from pipeline.simulators.mujoco import gait, pedestrian
from pipeline.simulators.mujoco.blueprints import BLUEPRINTS


@pytest.fixture(scope="module")
def walker() -> tuple[mujoco.MjModel, mujoco.MjData, pedestrian.Pedestrian]:
    spec = mujoco.MjSpec()
    spec.add_material(name="metal")
    pedestrian.add(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    return model, data, pedestrian.Pedestrian(model, data)


@pytest.mark.parametrize("speed", [0.5, 1.4, 2.5])
@pytest.mark.parametrize("animation", ["walking", "texting"])
def test_the_standing_foot_hardly_slides(
    walker: tuple[mujoco.MjModel, mujoco.MjData, pedestrian.Pedestrian], animation: str, speed: float
) -> None:
    model, data, person = walker
    person.dress(BLUEPRINTS["M 03"])
    feet = [model.geom(f"pedestrian_shoe_{side}").id for side in "lr"]
    slid, step = [], 0.01
    before = None
    for distance in np.arange(0, 2 * gait.stride(speed), step):
        person.place(float(distance), 0, 0, gait.pose(animation, gait.phase(float(distance), speed), speed))
        mujoco.mj_kinematics(model, data)
        places = data.geom_xpos[feet].copy()
        if before is not None:
            standing = 0 if np.cos(gait.phase(float(distance), speed)) <= 0 else 1
            slid.append(abs(places[standing, 0] - before[standing, 0]) / step)
        before = places
    # Per metre walked the standing foot slides a tenth, mostly while the weight changes feet.
    assert np.mean(slid) < 0.1


def test_speed_zero_stands() -> None:
    for animation in gait.ANIMATIONS:
        assert gait.phase(0.0, 0.0) == 0
        pose = gait.pose(animation, 0.0, 0.0)
        assert pose.angles["hip_l"] == pose.angles["hip_r"] and abs(pose.drop) < 0.35


def test_cadence_follows_speed() -> None:
    cadence = [speed / gait.stride(speed) for speed in (0.3, 0.8, 1.4, 2.0, 3.0)]
    assert cadence == sorted(cadence) and 0.8 < cadence[2] < 1.2  # Strides per second at a usual pace.
