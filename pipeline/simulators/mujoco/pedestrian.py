"""The pedestrian: an articulated body of capsules and ellipsoids.

A blueprint dresses it, an animation poses it.
"""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.scenarios.people import Blueprint
from pipeline.simulators.mujoco.gait import REFERENCE_HEIGHT_M, Posture

GEOM = mujoco.mjtGeom
GROUP = 2
"""Geom group of the pedestrian: ground truth renders this group alone."""
HIP_HEIGHT = 0.93
HIDDEN_Z = -1000.0
"""Metres: out of view for every camera."""
UMBRELLA = ("canopy", "shaft")
MATERIALS = ("top", "chest", "abdomen", "trousers", "shoes", "skin", "hair", "accent")


def add(spec: mujoco.MjSpec) -> None:
    """Add the pedestrian of the reference height to the world, at the origin and facing x."""
    for name in MATERIALS:
        spec.add_material(name=f"pedestrian_{name}", specular=0.05, shininess=0.1)
    root = spec.worldbody.add_body(name="pedestrian", pos=(0, 0, HIP_HEIGHT))
    for axis, direction in (("x", (1, 0, 0)), ("y", (0, 1, 0)), ("z", (0, 0, 1))):
        root.add_joint(name=f"pedestrian_{axis}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=direction)
    _hinge(root, "yaw", (0, 0, 1))
    _hinge(root, "pitch", (0, 1, 0))
    _hinge(root, "roll", (1, 0, 0))
    _ellipsoid(root, "pelvis", (0.125, 0.165, 0.12), (0, 0, 0.02), "trousers")
    _ellipsoid(root, "skirt", (0.165, 0.2, 0.27), (0, 0, -0.17), "trousers")
    torso = root.add_body(name="pedestrian_torso", pos=(0, 0, 0.08))
    _hinge(torso, "waist", (0, 1, 0))
    _capsule(torso, "abdomen", (0, -0.06, 0.08, 0, 0.06, 0.08), 0.12, "abdomen")
    _ellipsoid(torso, "chest", (0.13, 0.195, 0.23), (0, 0, 0.3), "chest")
    _capsule(torso, "shoulders", (0, -0.15, 0.44, 0, 0.15, 0.44), 0.065, "top")
    torso.add_geom(
        name="pedestrian_bag",
        type=GEOM.mjGEOM_BOX,
        size=(0.09, 0.14, 0.19),
        pos=(-0.2, 0, 0.3),
        material="pedestrian_shoes",
        group=GROUP,
    )
    _head(torso)
    _umbrella(torso)
    for side, sign in (("l", 1), ("r", -1)):
        upper = torso.add_body(name=f"pedestrian_arm_{side}", pos=(0, 0.215 * sign, 0.43))
        _hinge(upper, f"shoulder_{side}", (0, 1, 0))
        _hinge(upper, f"spread_{side}", (1, 0, 0))
        _capsule(upper, f"upper_arm_{side}", (0, 0, 0, 0, 0, -0.27), 0.052, "top")
        lower = upper.add_body(name=f"pedestrian_forearm_{side}", pos=(0, 0, -0.29))
        _hinge(lower, f"elbow_{side}", (0, 1, 0))
        _capsule(lower, f"forearm_{side}", (0, 0, 0, 0, 0, -0.22), 0.043, "top")
        _ellipsoid(lower, f"hand_{side}", (0.04, 0.03, 0.075), (0, 0, -0.3), "skin")
        _leg(root, side, sign)


def _head(torso: mujoco.MjsBody) -> None:
    head = torso.add_body(name="pedestrian_head", pos=(0, 0, 0.54))
    _hinge(head, "neck", (0, 1, 0))
    _capsule(head, "throat", (0, 0, -0.06, 0, 0, 0.04), 0.055, "skin")
    _ellipsoid(head, "face", (0.098, 0.08, 0.122), (0.01, 0, 0.13), "skin")
    _ellipsoid(head, "scalp", (0.1, 0.09, 0.105), (-0.015, 0, 0.165), "hair")
    _ellipsoid(head, "mane", (0.06, 0.1, 0.16), (-0.06, 0, 0.06), "hair")
    head.add_geom(
        name="pedestrian_hat",
        type=GEOM.mjGEOM_CYLINDER,
        size=(0.125, 0.035, 0),
        pos=(0, 0, 0.235),
        material="pedestrian_shoes",
        group=GROUP,
    )


def _umbrella(torso: mujoco.MjsBody) -> None:
    """An umbrella, held over the head.

    It occludes but is not part of the person, so ground truth does not render it.
    """
    torso.add_geom(
        name="pedestrian_canopy",
        type=GEOM.mjGEOM_ELLIPSOID,
        size=(0.52, 0.52, 0.13),
        pos=(0.08, 0, 0.92),
        material="pedestrian_accent",
    )
    torso.add_geom(
        name="pedestrian_shaft",
        type=GEOM.mjGEOM_CAPSULE,
        fromto=(0.24, -0.16, 0.2, 0.08, 0, 0.92),
        size=(0.012, 0, 0),
        material="metal",
    )


def _leg(root: mujoco.MjsBody, side: str, sign: int) -> None:
    thigh = root.add_body(name=f"pedestrian_thigh_{side}", pos=(0, 0.095 * sign, -0.02))
    _hinge(thigh, f"hip_{side}", (0, 1, 0))
    _capsule(thigh, f"thigh_{side}", (0, 0, 0, 0, 0, -0.4), 0.08, "trousers")
    shin = thigh.add_body(name=f"pedestrian_shin_{side}", pos=(0, 0, -0.43))
    _hinge(shin, f"knee_{side}", (0, 1, 0))
    _capsule(shin, f"shin_{side}", (0, 0, 0, 0, 0, -0.38), 0.058, "trousers")
    foot = shin.add_body(name=f"pedestrian_foot_{side}", pos=(0, 0, -0.42))
    _hinge(foot, f"ankle_{side}", (0, 1, 0))
    foot.add_geom(
        name=f"pedestrian_shoe_{side}",
        type=GEOM.mjGEOM_BOX,
        size=(0.13, 0.045, 0.04),
        pos=(0.06, 0, -0.02),
        material="pedestrian_shoes",
        group=GROUP,
    )


def _hinge(body: mujoco.MjsBody, name: str, axis: tuple[int, int, int]) -> None:
    body.add_joint(name=f"pedestrian_{name}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)


def _capsule(
    body: mujoco.MjsBody, name: str, ends: tuple[float, ...], radius: float, material: str
) -> None:
    """Add a capsule; ends: x, y, z of both ends, metres."""
    body.add_geom(
        name=f"pedestrian_{name}",
        type=GEOM.mjGEOM_CAPSULE,
        fromto=ends,
        size=(radius, 0, 0),
        material=f"pedestrian_{material}",
        group=GROUP,
    )


def _ellipsoid(
    body: mujoco.MjsBody, name: str, size: tuple[float, ...], pos: tuple[float, ...], material: str
) -> None:
    body.add_geom(
        name=f"pedestrian_{name}",
        type=GEOM.mjGEOM_ELLIPSOID,
        size=size,
        pos=pos,
        material=f"pedestrian_{material}",
        group=GROUP,
    )


class Pedestrian:
    """The pedestrian of a compiled model: dressed once per episode, posed once per frame."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model, self._data = model, data
        umbrella = [model.geom(f"pedestrian_{name}").id for name in UMBRELLA]
        self._geoms = np.concatenate([np.flatnonzero(model.geom_group == GROUP), umbrella])
        self._bodies = [
            i for i in range(model.nbody) if model.body(i).name.startswith("pedestrian")
        ]
        self._root = model.body("pedestrian").id
        self._joints = {
            model.joint(i).name.removeprefix("pedestrian_"): model.jnt_qposadr[i]
            for i in range(model.njnt)
        }
        self._size, self._position, self._offset = (
            model.geom_size.copy(),
            model.geom_pos.copy(),
            model.body_pos.copy(),
        )
        self._scale = 1.0

    def dress(self, blueprint: Blueprint) -> None:
        """Apply a blueprint's proportions and colours."""
        model, k = self._model, blueprint.height / REFERENCE_HEIGHT_M
        self._scale = k
        for i in self._geoms:
            # The second size of capsule and cylinder is half their length, not a breadth.
            upright = model.geom_type[i] in (GEOM.mjGEOM_CAPSULE, GEOM.mjGEOM_CYLINDER)
            breadth = (blueprint.build, 1, 1) if upright else (blueprint.build, blueprint.build, 1)
            model.geom_size[i] = self._size[i] * k * np.array(breadth)
            model.geom_pos[i] = self._position[i] * k
        for body in self._bodies:
            model.body_pos[body] = self._offset[body] * k
        for name in MATERIALS:
            model.mat_rgba[model.material(f"pedestrian_{name}").id, :3] = getattr(blueprint, name)
        shown_parts = {
            "mane": blueprint.long_hair,
            "hat": blueprint.hat,
            "bag": blueprint.bag,
            "skirt": blueprint.skirt,
        }
        for name, shown in (shown_parts | dict.fromkeys(UMBRELLA, blueprint.umbrella)).items():
            i = model.geom(f"pedestrian_{name}").id
            if not shown:  # The depth pass draws alpha 0, too: shrink it into the body instead.
                model.geom_size[i] = 0.01
                model.geom_pos[i] = 0

    def place(self, x: float, y: float, yaw: float, pose: Posture) -> None:
        """Place the pedestrian at (x, y) metres, facing `yaw` radians, in a pose."""
        self._set("x", x)
        self._set("y", y)
        self._set("yaw", yaw)
        self._set("z", pose.drop * self._scale)
        for joint, angle in pose.angles.items():
            self._set(joint, angle)

    def hide(self) -> None:
        """Remove the pedestrian from the scene."""
        self._set("z", HIDDEN_Z)

    def _set(self, joint: str, value: float) -> None:
        self._data.qpos[self._joints[joint]] = value
