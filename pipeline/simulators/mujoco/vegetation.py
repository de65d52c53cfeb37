"""Trees and hedges along a street."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.scenarios.streets import CORNER_RADIUS, PAVEMENT_WIDTH, Street, Town
from pipeline.simulators.mujoco.mesh import Mesh, Site, loft
from pipeline.simulators.mujoco.style import Style

GEOM = mujoco.mjtGeom


def add(site: Site, town: Town, street: Street, side: int, rng: np.random.Generator) -> None:
    dense = town.overgrown(side)
    v = side * (street.edge(side) + PAVEMENT_WIDTH + (1.2 if dense else -0.6))
    spacing = 7.5 if dense else 19.0
    start = street.start if street.name == "main" else CORNER_RADIUS + 4
    for i, u in enumerate(np.arange(start + rng.uniform(0, spacing), street.end, spacing)):
        if not street.open(side, float(u), margin=2):
            add_tree(site.body, float(u), v + rng.uniform(-0.4, 0.4), i, rng)
    if not dense:
        return
    hedge = Mesh()
    for u in np.arange(start, street.end - 8.2, 9.0):
        if street.open(side, float(u) + 4, margin=5):
            continue
        top, inner, outer = rng.uniform(0.9, 1.5), v - side * 0.2, v + side * 1.1
        low, high = min(inner, outer), max(inner, outer)
        hedge.quad((u, low, top), (8.2, 0, 0), (0, high - low, 0), (0, 0, 4, 0.7), cell=2)
        face = (u, inner, 0) if side > 0 else (u + 8.2, inner, 0)
        hedge.quad(face, (side * 8.2, 0, 0), (0, 0, top), (0, 1, 4, 0.3), cell=2)
        hedge.quad((u, high, 0), (0, low - high, 0), (0, 0, top), (0, 1, 0.7, 0.3))
    site.put(f"{street.name}_hedge_{side}", hedge, "hedge")


def add_tree(body: mujoco.MjsBody, u: float, v: float, i: int, rng: np.random.Generator) -> None:
    height, angle = rng.uniform(2.3, 3.1), rng.uniform(0, 2 * np.pi)
    body.add_geom(
        type=GEOM.mjGEOM_CAPSULE,
        fromto=(u, v, 0, u, v, height + 0.8),
        size=(rng.uniform(0.1, 0.17), 0, 0),
        material="bark",
    )
    body.add_geom(
        type=GEOM.mjGEOM_MESH,
        meshname=f"crown{i % 3}",
        pos=(u, v, height + rng.uniform(1.3, 1.7)),
        quat=(np.cos(angle / 2), 0, 0, np.sin(angle / 2)),
        material="leaves",
        castshadow=i % 2 == 0,
    )


def declare_crowns(spec: mujoco.MjSpec, style: Style, rng: np.random.Generator) -> None:
    """Three lumpy crowns: rings of a sphere, or of a cone, whose radius wobbles."""
    for i in range(3):
        rings, points = 8, 12
        latitude = np.linspace(-0.48 * np.pi, 0.48 * np.pi, rings)
        around = np.linspace(0, 2 * np.pi, points, endpoint=False)
        radius = rng.uniform(0.82, 1.18, (rings, points)) * rng.uniform(1.5, 2.0)
        circle = np.stack([np.cos(around), np.sin(around)], -1)
        if style.conical:
            width, lift = 0.75 * np.linspace(1, 0.06, rings), np.linspace(-0.9, 2.2, rings)
        else:
            width, lift = np.cos(latitude), 0.85 * np.sin(latitude)
        rows = [
            np.column_stack(
                [
                    circle * (radius[k] * width[k])[:, None],
                    np.full(points, radius[k].mean() * lift[k]),
                ]
            )
            for k in range(rings)
        ]
        loft(spec, f"crown{i}", rows)
