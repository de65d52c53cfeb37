"""Cars and buses: meshes, materials and mocap bodies that a scenario can place anywhere.

A vehicle's frame is on the ground at its centre, x ahead, y left, metres.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from pipeline.scenarios.functional import HALF_LENGTHS_M, VehicleKind
from pipeline.simulators.mujoco import textures
from pipeline.simulators.mujoco.mesh import Mesh, loft

GEOM = mujoco.mjtGeom
PAINTS = (
    (0.62, 0.08, 0.08),
    (0.82, 0.83, 0.84),
    (0.08, 0.14, 0.32),
    (0.1, 0.1, 0.11),
    (0.42, 0.44, 0.46),
    (0.1, 0.28, 0.2),
    (0.72, 0.6, 0.32),
)
BUS_COLOURS = {"urban": (186, 44, 36), "suburban": (52, 96, 150)}

# Stations along a car, rear to front: x, bottom, waistline, half width (metres).
BODIES = {
    "hatchback": [
        (-1.95, 0.42, 0.78, 0.7),
        (-1.8, 0.26, 0.96, 0.84),
        (-0.9, 0.2, 0.97, 0.88),
        (0.75, 0.2, 0.95, 0.88),
        (1.5, 0.22, 0.82, 0.85),
        (1.95, 0.34, 0.66, 0.7),
    ],
    "saloon": [
        (-2.25, 0.42, 0.8, 0.7),
        (-2.1, 0.26, 0.93, 0.84),
        (-1.2, 0.2, 0.97, 0.89),
        (0.85, 0.2, 0.95, 0.89),
        (1.8, 0.22, 0.8, 0.86),
        (2.25, 0.34, 0.64, 0.7),
    ],
    "van": [
        (-2.4, 0.4, 1.05, 0.86),
        (-2.3, 0.25, 1.15, 0.93),
        (0.9, 0.25, 1.15, 0.95),
        (1.7, 0.25, 1.05, 0.93),
        (2.35, 0.3, 0.9, 0.86),
        (2.45, 0.4, 0.75, 0.76),
    ],
    "estate": [
        (-2.35, 0.4, 0.86, 0.74),
        (-2.25, 0.26, 0.98, 0.86),
        (-1.0, 0.2, 0.98, 0.9),
        (0.95, 0.2, 0.95, 0.9),
        (1.9, 0.22, 0.8, 0.86),
        (2.35, 0.34, 0.62, 0.7),
    ],
    "suv": [
        (-2.3, 0.5, 1.0, 0.8),
        (-2.15, 0.36, 1.12, 0.92),
        (-0.9, 0.32, 1.14, 0.95),
        (0.9, 0.32, 1.12, 0.95),
        (1.85, 0.34, 1.02, 0.92),
        (2.3, 0.46, 0.86, 0.8),
    ],
}
# Greenhouse: rear and front ends at the waist and at the roof, roof height.
CABINS = {
    "hatchback": (-1.85, -1.35, 0.25, 1.0, 1.47),
    "saloon": (-1.65, -0.95, 0.3, 1.1, 1.44),
    "van": (-2.3, -2.2, 1.05, 1.75, 1.98),
    "estate": (-2.25, -1.95, 0.4, 1.15, 1.46),
    "suv": (-2.2, -1.9, 0.35, 1.05, 1.72),
}


def declare(spec: mujoco.MjSpec, style: str, rng: np.random.Generator) -> None:
    """Declare the assets that all vehicles of a world share."""
    for kind, stations in BODIES.items():
        loft(spec, f"{kind}_body", [_section(*station) for station in stations])
        _cabin(spec, kind)
    spec.add_material(name="paint", specular=0.6, shininess=0.7)
    spec.add_material(name="glass", rgba=(0.1, 0.13, 0.16, 1), specular=0.9, shininess=0.9)
    spec.add_material(name="rubber", rgba=(0.06, 0.06, 0.06, 1), specular=0)
    spec.add_material(name="lamp_front", rgba=(0.93, 0.93, 0.86, 1))
    spec.add_material(name="lamp_rear", rgba=(0.55, 0.05, 0.05, 1))
    colour = BUS_COLOURS[style]
    textures.add(spec, "bus_side", textures.bus_side(colour, rng), specular=0.4, shininess=0.6)
    textures.add(spec, "bus_front", textures.bus_end(colour, front=True))
    textures.add(spec, "bus_rear", textures.bus_end(colour, front=False))
    _bus_meshes(spec)


def _section(x: float, bottom: float, waist: float, half: float) -> NDArray[np.float64]:
    """One closed ring of eight points around the body: sill, bulge and shoulder on either side."""
    middle = bottom + 0.45 * (waist - bottom)
    right = [
        (0.82 * half, bottom),
        (half, middle),
        (0.97 * half, waist - 0.06),
        (0.86 * half, waist),
    ]
    return np.array([(x, y, z) for y, z in right] + [(x, -y, z) for y, z in reversed(right)])


def _cabin(spec: mujoco.MjSpec, kind: str) -> None:
    rear_waist, rear_roof, front_roof, front_waist, height = CABINS[kind]
    waist = max(station[2] for station in BODIES[kind]) - 0.04
    half = max(station[3] for station in BODIES[kind])
    rings = []
    for share in (0.0, 1.0):
        low, high = (rear_waist, rear_roof) if share == 0 else (front_waist, front_roof)
        rings.append(
            [
                (low, 0.84 * half, waist),
                (high, 0.66 * half, height),
                (high, -0.66 * half, height),
                (low, -0.84 * half, waist),
            ]
        )
    loft(spec, f"{kind}_glass", rings)
    roof = Mesh()
    y = 0.68 * half
    roof.quad(
        (rear_roof, -y, height + 0.015), (front_roof - rear_roof, 0, 0), (0, 2 * y, 0), (0, 0, 1, 1)
    )
    for x0, x1 in (
        (rear_waist, rear_roof),
        (front_waist, front_roof),
        (0.5 * (rear_waist + front_waist) - 0.1, 0.5 * (rear_roof + front_roof) - 0.1),
    ):
        for side in (-1, 1):
            bottom, top = (
                np.array([x0, side * 0.855 * half, waist]),
                np.array([x1, side * 0.675 * half, height]),
            )
            edge = np.array([0.11, 0, 0])
            roof.quad(
                bottom if side < 0 else bottom + edge,
                edge if side < 0 else -edge,
                top - bottom,
                (0, 0, 1, 1),
            )
    roof.add_to(spec, f"{kind}_roof")


def _bus_meshes(spec: mujoco.MjSpec) -> None:
    half, wide, low, high = 4.5, 1.25, 0.35, 3.05
    sides, front, rear = Mesh(), Mesh(), Mesh()
    up = (0, 0, high - low)
    sides.quad((-half, -wide, low), (2 * half, 0, 0), up, (0, 1, 1, 0), cell=1.5)
    sides.quad((half, wide, low), (-2 * half, 0, 0), up, (0, 1, 1, 0), cell=1.5)
    front.quad((half, -wide, low), (0, 2 * wide, 0), up, (0, 1, 1, 0), cell=1.5)
    rear.quad((-half, wide, low), (0, -2 * wide, 0), up, (0, 1, 1, 0), cell=1.5)
    for name, mesh in (("bus_side", sides), ("bus_front", front), ("bus_rear", rear)):
        mesh.add_to(spec, name)


def add(spec: mujoco.MjSpec, name: str, kind: VehicleKind, paint: int = 0) -> None:
    """Add a vehicle as a mocap body with that name; the mocap pose places it."""
    body = spec.worldbody.add_body(name=name, mocap=True)
    if kind == "bus":
        _add_bus(body)
        return
    rgba = (*PAINTS[paint % len(PAINTS)], 1)
    body.add_geom(type=GEOM.mjGEOM_MESH, meshname=f"{kind}_body", material="paint", rgba=rgba)
    body.add_geom(type=GEOM.mjGEOM_MESH, meshname=f"{kind}_glass", material="glass")
    body.add_geom(
        type=GEOM.mjGEOM_MESH,
        meshname=f"{kind}_roof",
        material="paint",
        rgba=rgba,
        castshadow=False,
    )
    length, half = HALF_LENGTHS_M[kind], BODIES[kind][2][3]
    _wheels(body, 0.62 * length, half - 0.1, 0.32)
    for station, material in ((BODIES[kind][-1], "lamp_front"), (BODIES[kind][0], "lamp_rear")):
        x, bottom, waist, end = station
        for side in (-1, 1):
            place = (x, side * 0.74 * end, bottom + 0.72 * (waist - bottom))
            body.add_geom(
                type=GEOM.mjGEOM_BOX,
                size=(0.04, 0.15, 0.07),
                pos=place,
                material=material,
                castshadow=False,
            )
    body.add_geom(
        type=GEOM.mjGEOM_BOX,
        size=(0.01, 0.26, 0.06),
        pos=(-length - 0.01, 0, BODIES[kind][0][1] + 0.14),
        rgba=(0.9, 0.9, 0.82, 1),
        castshadow=False,
    )


def _add_bus(body: mujoco.MjsBody) -> None:
    for part in ("bus_side", "bus_front", "bus_rear"):
        body.add_geom(type=GEOM.mjGEOM_MESH, meshname=part, material=part, castshadow=False)
    # The skin is open below and above; this inner box closes it and casts the shadow.
    body.add_geom(
        type=GEOM.mjGEOM_BOX, size=(4.47, 1.22, 1.37), pos=(0, 0, 1.72), rgba=(0.8, 0.8, 0.8, 1)
    )
    body.add_geom(
        type=GEOM.mjGEOM_BOX,
        size=(4.4, 1.15, 0.1),
        pos=(0, 0, 0.3),
        rgba=(0.07, 0.07, 0.07, 1),
        castshadow=False,
    )
    _wheels(body, 2.7, 1.12, 0.47)


def _wheels(body: mujoco.MjsBody, x: float, y: float, radius: float) -> None:
    upright = (np.sqrt(0.5), np.sqrt(0.5), 0, 0)
    for along in (-x, x):
        for side in (-y, y):
            body.add_geom(
                type=GEOM.mjGEOM_CYLINDER,
                size=(radius, 0.11, 0),
                pos=(along, side, radius),
                quat=upright,
                material="rubber",
                castshadow=False,
            )
            cap = (along, side + np.sign(side) * 0.1, radius)
            body.add_geom(
                type=GEOM.mjGEOM_CYLINDER,
                size=(0.55 * radius, 0.02, 0),
                pos=cap,
                quat=upright,
                rgba=(0.6, 0.61, 0.63, 1),
                castshadow=False,
            )
