"""Street furniture: lamps, bins, benches, signs, the bus stop, a level crossing."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from pipeline.scenarios.streets import (
    CORNER_RADIUS,
    PAVEMENT_WIDTH,
    RAIL_M,
    START_X,
    Street,
    Town,
    streets,
)
from pipeline.simulators.mujoco.mesh import Mesh, place
from pipeline.simulators.mujoco.style import STYLES, Style

GEOM = mujoco.mjtGeom
LAMP_SPACING = 22.0


def lamp_positions(town: Town) -> np.ndarray:
    """(n, 3) metres, world frame: positions of the street lamps' lights."""
    style = STYLES[town.style]
    return np.array(
        [
            (
                *street.world(u, side * (street.edge(side, u) + 0.5 - style.lamp_reach)),
                style.lamp_height,
            )
            for street, u, side in _lamps(town)
        ]
    )


def _lamps(town: Town) -> Iterator[tuple[Street, float, int]]:
    """Street, place along it and side of each lamp, on alternating sides."""
    for street in streets(town):
        for i, u in enumerate(
            np.arange(
                street.start + (9 if street.name == "main" else CORNER_RADIUS + 3),
                street.end,
                LAMP_SPACING,
            )
        ):
            side = 1 if i % 2 else -1
            if not street.open(side, float(u), margin=0.5):
                yield street, float(u), side


def add(body: mujoco.MjsBody, town: Town, street: Street, rng: np.random.Generator) -> None:
    style = STYLES[town.style]
    for owner, u, side in _lamps(town):
        if owner.name == street.name:
            _lamp(body, style, street, u, side)
    for _ in range(6):
        u, side = (
            float(rng.uniform(street.start + CORNER_RADIUS, street.end)),
            int(rng.choice([-1, 1])),
        )
        v = side * (street.edge(side) + PAVEMENT_WIDTH - 0.5)
        if street.open(side, u, margin=1):
            continue
        if rng.random() < 0.5:
            body.add_geom(
                type=GEOM.mjGEOM_CYLINDER,
                size=(0.22, 0.42, 0),
                pos=(u, v, 0.55),
                material="metal",
                castshadow=False,
            )
        else:
            body.add_geom(
                type=GEOM.mjGEOM_BOX,
                size=(0.8, 0.22, 0.04),
                pos=(u, v, 0.55),
                material="bark",
                castshadow=False,
            )
            body.add_geom(
                type=GEOM.mjGEOM_BOX,
                size=(0.8, 0.03, 0.2),
                pos=(u, v + side * 0.22, 0.85),
                material="bark",
                castshadow=False,
            )
    for u in (START_X + 30, 8.0, 70.0) if street.name == "main" else (30.0,):
        if not street.open(-1, u, margin=1) and not (
            street.bay and street.bay[0] < u < street.bay[1]
        ):
            _sign(body, u, -(street.right + 0.4))
    if street.bay:
        _bus_stop(body, street, street.bay)


def _lamp(body: mujoco.MjsBody, style: Style, street: Street, u: float, side: int) -> None:
    foot, z = side * (street.edge(side, u) + 0.5), style.lamp_height
    v = foot - side * style.lamp_reach
    body.add_geom(
        type=GEOM.mjGEOM_CAPSULE,
        fromto=(u, foot, 0, u, foot, z),
        size=(0.07, 0, 0),
        material="metal",
        castshadow=False,
    )
    body.add_geom(
        type=GEOM.mjGEOM_CAPSULE,
        fromto=(u, foot, z, u, v, z + 0.15),
        size=(0.04, 0, 0),
        material="metal",
        castshadow=False,
    )
    if style.lamp_reach > 1:
        body.add_geom(
            type=GEOM.mjGEOM_BOX,
            size=(0.3, 0.16, 0.06),
            pos=(u, v, z + 0.12),
            material="street_lamp",
            castshadow=False,
        )
    else:
        body.add_geom(
            type=GEOM.mjGEOM_SPHERE,
            size=(0.2, 0, 0),
            pos=(u, v, z),
            material="street_lamp",
            castshadow=False,
        )


def _sign(body: mujoco.MjsBody, u: float, v: float) -> None:
    facing = (np.sqrt(0.5), 0, np.sqrt(0.5), 0)
    body.add_geom(
        type=GEOM.mjGEOM_CAPSULE,
        fromto=(u, v, 0, u, v, 2.3),
        size=(0.035, 0, 0),
        material="metal",
        castshadow=False,
    )
    for du, radius, rgba in (
        (0.0, 0.3, (0.75, 0.06, 0.08, 1)),
        (-0.01, 0.22, (0.93, 0.93, 0.92, 1)),
    ):
        size = (radius, 0.015 - du / 2, 0)
        body.add_geom(
            type=GEOM.mjGEOM_CYLINDER,
            size=size,
            pos=(u + du, v, 2.5),
            quat=facing,
            rgba=rgba,
            castshadow=False,
        )


def _bus_stop(body: mujoco.MjsBody, street: Street, bay: tuple[float, float]) -> None:
    u, v = bay[0] + 0.35 * (bay[1] - bay[0]), -(street.edge(-1) + 1.9)
    glass = (0.45, 0.55, 0.58, 1)
    body.add_geom(
        type=GEOM.mjGEOM_BOX,
        size=(2.0, 0.75, 0.05),
        pos=(u, v, 2.5),
        material="metal",
        castshadow=False,
    )
    body.add_geom(
        type=GEOM.mjGEOM_BOX,
        size=(2.0, 0.03, 1.0),
        pos=(u, v - 0.7, 1.3),
        rgba=glass,
        castshadow=False,
    )
    for du in (-1.95, 1.95):
        body.add_geom(
            type=GEOM.mjGEOM_BOX,
            size=(0.04, 0.7, 1.2),
            pos=(u + du, v, 1.3),
            rgba=glass,
            castshadow=False,
        )
    body.add_geom(
        type=GEOM.mjGEOM_BOX,
        size=(1.4, 0.2, 0.04),
        pos=(u, v - 0.4, 0.6),
        material="bark",
        castshadow=False,
    )


def add_rails(spec: mujoco.MjSpec, town: Town, x: float) -> None:
    """A train line across the main street: gravel, two rails, a St Andrew's cross either side."""
    world, main = spec.worldbody, streets(town)[0]
    gravel = Mesh()
    for low, high in ((-60.0, -main.right), (main.left, 60.0)):
        gravel.quad((x - 2.2, low, 0.03), (4.4, 0, 0), (0, high - low, 0), (0, 0, 1, 1), cell=2)
    gravel.add_to(spec, "gravel")
    place(world, "gravel", "gravel")
    for dx in (-RAIL_M, RAIL_M):
        world.add_geom(
            type=GEOM.mjGEOM_BOX,
            size=(0.04, 60, 0.02),
            pos=(x + dx, 0, 0.0),
            rgba=(0.5, 0.46, 0.43, 1),
            castshadow=False,
        )
        for low, high in ((-60.0, -main.right), (main.left, 60.0)):
            world.add_geom(
                type=GEOM.mjGEOM_BOX,
                size=(0.04, (high - low) / 2, 0.06),
                pos=(x + dx, (low + high) / 2, 0.1),
                rgba=(0.5, 0.46, 0.43, 1),
                castshadow=False,
            )
    for px, v in ((x - 4, -(main.right + 0.6)), (x + 4, main.left + 0.6)):
        world.add_geom(
            type=GEOM.mjGEOM_CAPSULE,
            fromto=(px, v, 0, px, v, 2.6),
            size=(0.045, 0, 0),
            material="metal",
            castshadow=False,
        )
        for tilt in (np.pi / 8, -np.pi / 8):
            world.add_geom(
                type=GEOM.mjGEOM_BOX,
                size=(0.02, 0.6, 0.08),
                pos=(px - 0.06, v, 2.5),
                quat=(np.cos(tilt), np.sin(tilt), 0, 0),
                rgba=(0.9, 0.2, 0.15, 1),
                castshadow=False,
            )
