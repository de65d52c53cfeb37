"""The MuJoCo model of a functional scenario: streets, vehicles, pedestrian, ego and lights."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from pipeline.scenarios.functional import Actor
from pipeline.scenarios.streets import Town
from pipeline.simulators.mujoco import pedestrian, town, vehicles

EGO_MASS_KG = 1500.0
TIMESTEP_S = 0.005
CAMERA_X_M, CAMERA_Z_M = 0.5, 1.35
STREET_LIGHTS = 4
HEADLIGHTS_M = {"head_left": (2.3, 0.65, 0.7), "head_right": (2.3, -0.65, 0.7)}
"""Of each lamp in the ego's frame: x ahead, y left, z up."""
HEADLIGHT_AXIS, HEADLIGHT_CUTOFF_DEG, HEADLIGHT_EXPONENT, HEADLIGHT_COLOUR = (
    (1.0, 0.0, -0.035),
    34.0,
    9.0,
    (1.5, 1.48, 1.35),
)
HEADLIGHT_FADE = 0.0016
"""Loss with the square of the distance in metres: flatter than the inverse square, as the exposure
flattens what a camera shows."""
SHADOW_MAP = 1024


def describe(
    layout: Town, actors: Mapping[str, Actor], fovy_deg: float, width: int, height: int
) -> mujoco.MjSpec:
    """A world, ready to compile; `actors` become mocap bodies with those names."""
    spec = mujoco.MjSpec()
    _settings(spec, width, height)
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        width=128,
        height=768,
    )
    town.add(spec, layout)
    vehicles.declare(spec, layout.style, np.random.default_rng([11, layout.seed]))
    for name, actor in actors.items():
        vehicles.add(spec, name, actor.kind, actor.paint)
    pedestrian.add(spec)
    _lights(spec)
    _ego(spec, fovy_deg)
    return spec


def _settings(spec: mujoco.MjSpec, width: int, height: int) -> None:
    spec.option.timestep = TIMESTEP_S
    spec.option.gravity = (0, 0, 0)  # The height of all road users is prescribed.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.default.geom.contype = spec.default.geom.conaffinity = (
        0  # Contact is judged on footprints; flat meshes have no hull.
    )
    spec.stat.extent, spec.stat.center = 1, (0, 0, 0)  # Makes near, far and shadow sizes metres.
    visual = spec.visual
    visual.global_.offwidth, visual.global_.offheight = width, height
    quality = visual.quality
    quality.shadowsize, quality.offsamples = SHADOW_MAP, 0
    quality.numslices, quality.numstacks, quality.numquads = 10, 6, 2
    visual.map.znear, visual.map.zfar = 0.2, 260
    visual.map.shadowclip, visual.map.shadowscale = 32, 0.6
    visual.headlight.active = 1
    visual.headlight.diffuse = visual.headlight.specular = (0, 0, 0)


def _lights(spec: mujoco.MjSpec) -> None:
    kind = mujoco.mjtLightType
    spec.worldbody.add_light(
        name="sun",
        type=kind.mjLIGHT_DIRECTIONAL,
        pos=(0, 0, 40),
        dir=(0, 0, -1),
        castshadow=True,
        ambient=(0, 0, 0),
    )
    for i in range(STREET_LIGHTS):
        spec.worldbody.add_light(
            name=f"street{i}",
            type=kind.mjLIGHT_SPOT,
            pos=(0, 0, 6.0),
            dir=(0, 0, -1),
            cutoff=70,
            exponent=2,
            attenuation=(1, 0, 0.012),
            castshadow=False,
            diffuse=(1.7, 1.4, 0.95),
            ambient=(0, 0, 0),
            specular=(0.3, 0.25, 0.2),
        )


def _ego(spec: mujoco.MjSpec, fovy_deg: float) -> None:
    """The ego: a mass that travels along its route, and a body that follows the mass.

    The mass has one degree of freedom, the metres travelled; a motor behind a first-order lag
    brakes it. The body carries the camera and the headlights.
    """
    mass = spec.worldbody.add_body(
        name="ego_mass", mass=EGO_MASS_KG, inertia=(500, 2000, 2000), explicitinertial=True
    )
    mass.add_joint(name="ego_travelled", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1, 0, 0))
    ego = spec.worldbody.add_body(name="ego", mocap=True)
    # MuJoCo's cameras look along their -z: this turns x to the right and y up, along the ego's x.
    ego.add_camera(
        name="camera", pos=(CAMERA_X_M, 0, CAMERA_Z_M), quat=(0.5, 0.5, -0.5, -0.5), fovy=fovy_deg
    )
    for name, position in HEADLIGHTS_M.items():
        ego.add_light(
            name=name,
            type=mujoco.mjtLightType.mjLIGHT_SPOT,
            pos=position,
            dir=HEADLIGHT_AXIS,
            cutoff=HEADLIGHT_CUTOFF_DEG,
            exponent=HEADLIGHT_EXPONENT,
            attenuation=(1, 0, HEADLIGHT_FADE),
            castshadow=False,
            diffuse=HEADLIGHT_COLOUR,
            ambient=(0, 0, 0),
            specular=(0.2, 0.2, 0.2),
        )
    brake = spec.add_actuator(
        name="brake", target="ego_travelled", trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    brake.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
