"""Standing feet do not slide, and a pedestrian at speed 0 stands still."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from pipeline.scenarios.people import Blueprint, population
from pipeline.simulators.mujoco import gait, pedestrian

PEOPLE = [*population(1).values(), *population(2).values()]
AVERAGE = replace(PEOPLE[0], height=gait.REFERENCE_HEIGHT_M, stride=1.0)


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
@pytest.mark.parametrize(
    "who",
    [
        max(PEOPLE, key=lambda p: p.stride), min(PEOPLE, key=lambda p: p.stride),
        max(PEOPLE, key=lambda p: p.height), min(PEOPLE, key=lambda p: p.height),
    ],
    ids=["longest stride", "shortest stride", "tallest", "smallest"],
)  # fmt: skip
def test_the_standing_foot_hardly_slides(
    walker: tuple[mujoco.MjModel, mujoco.MjData, pedestrian.Pedestrian],
    who: Blueprint,
    animation: str,
    speed: float,
) -> None:
    model, data, person = walker
    person.dress(who)
    feet = [model.geom(f"pedestrian_shoe_{side}").id for side in "lr"]
    slid, step = [], 0.01
    before = None
    for distance in np.arange(0, 2 * gait.stride(speed, who), step):
        person.place(
            float(distance),
            0,
            0,
            gait.pose(animation, gait.phase(float(distance), speed, who), speed, who),
        )
        mujoco.mj_kinematics(model, data)
        places = data.geom_xpos[feet].copy()
        if before is not None:
            standing = 0 if np.cos(gait.phase(float(distance), speed, who)) <= 0 else 1
            slid.append(abs(places[standing, 0] - before[standing, 0]) / step)
        before = places
    # Per metre walked the standing foot slides a tenth, mostly while the weight changes feet.
    assert np.mean(slid) < 0.1


def test_speed_zero_stands() -> None:
    for animation in gait.ANIMATIONS:
        assert gait.phase(0.0, 0.0, AVERAGE) == 0
        pose = gait.pose(animation, 0.0, 0.0, AVERAGE)
        assert pose.angles["hip_l"] == pose.angles["hip_r"] and abs(pose.drop) < 0.35


def test_cadence_follows_speed() -> None:
    cadence = [speed / gait.stride(speed, AVERAGE) for speed in (0.3, 0.8, 1.4, 2.0, 3.0)]
    assert (
        cadence == sorted(cadence) and 0.8 < cadence[2] < 1.2
    )  # Strides per second at a usual pace.


def test_a_stride_grows_with_the_factor_and_the_height() -> None:
    """At 1.4 m/s the average person of 1.75 m takes 0.7 m + 0.5 s * 1.4 m/s = 1.4 m a cycle."""
    assert gait.stride(1.4, AVERAGE) == pytest.approx(1.4)
    assert gait.stride(1.4, replace(AVERAGE, stride=1.1, height=1.4)) == pytest.approx(
        1.4 * 1.1 * 0.8
    )


def test_arms_and_back_follow_the_person() -> None:
    calm, lively = (
        gait.pose("walking", 1.0, 1.4, replace(AVERAGE, arm_swing=factor, stoop=0.0))
        for factor in (0.5, 1.5)
    )
    assert lively.angles["shoulder_l"] == pytest.approx(3 * calm.angles["shoulder_l"])
    bent = gait.pose("walking", 1.0, 1.4, replace(AVERAGE, arm_swing=0.5, stoop=0.1))
    assert {name for name in bent.angles if bent.angles[name] != calm.angles[name]} == {"waist"}
    assert bent.angles["waist"] - calm.angles["waist"] == pytest.approx(0.1)
