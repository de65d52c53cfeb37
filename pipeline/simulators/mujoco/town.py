"""Builds a street of a town: road, pavements, buildings, vegetation, street furniture.

World frame, metres: x along the road in the ego's driving direction, y left, z up; the conflict point has x = 0. Right-hand traffic.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from pipeline.scenario import Town

from . import textures
from .mesh import Mesh, loft, place

GEOM = mujoco.mjtGeom
START_X, END_X = -75.0, 150.0
ROAD_HALF_WIDTH = 3.5
PAVEMENT_WIDTH = 3.0
BAY_DEPTH = 3.1
KERB_HEIGHT = 0.12
LAMP_SPACING = 22.0
LAMP_HEIGHT = 6.2


@dataclass(frozen=True)
class Style:
    """What makes a town look like itself."""

    walls: tuple[textures.Colour, ...]
    brick: tuple[bool, ...]
    roofs: tuple[textures.Colour, ...]
    asphalt: int
    paving: textures.Colour
    leaves: textures.Colour
    storeys: tuple[int, int]
    widths: tuple[float, float]
    gap: float
    setback: float
    shops: bool
    lamp_reach: float


STYLES = {
    "urban": Style(
        walls=((178, 112, 88), (204, 190, 162), (150, 150, 154), (214, 200, 160), (132, 88, 72)),
        brick=(True, False, False, False, True),
        roofs=((96, 58, 48), (74, 74, 80)),
        asphalt=74,
        paving=(150, 147, 140),
        leaves=(62, 92, 44),
        storeys=(2, 5),
        widths=(11.0, 18.0),
        gap=0.25,
        setback=1.6,
        shops=True,
        lamp_reach=1.5,
    ),
    "suburban": Style(
        walls=((226, 218, 200), (196, 150, 120), (170, 182, 186), (232, 226, 214)),
        brick=(False, True, False, False),
        roofs=((126, 70, 54), (88, 72, 64)),
        asphalt=92,
        paving=(128, 122, 118),
        leaves=(84, 106, 46),
        storeys=(1, 2),
        widths=(9.0, 13.0),
        gap=5.0,
        setback=6.0,
        shops=False,
        lamp_reach=0.6,
    ),
}


def lamp_positions(town: Town) -> np.ndarray:
    """(n, 3) metres: where the street lamps' light comes from, alternating sides."""
    xs = np.arange(START_X + 9, END_X, LAMP_SPACING)
    reach = ROAD_HALF_WIDTH + 0.5 - STYLES[town.style].lamp_reach
    return np.array([(x, reach * (1 if i % 2 else -1), LAMP_HEIGHT) for i, x in enumerate(xs)])


def add(spec: mujoco.MjSpec, town: Town) -> None:
    """Add the street to an empty model."""
    rng = np.random.default_rng([7, town.seed])
    style = STYLES[town.style]
    _declare_surfaces(spec, style, rng)
    _ground(spec, town)
    _markings(spec, rng)
    for side in (-1, 1):
        _buildings(spec, town, style, side, rng)
        _trees(spec, town, style, side, rng)
    _furniture(spec, town, style, rng)


def _declare_surfaces(spec: mujoco.MjSpec, style: Style, rng: np.random.Generator) -> None:
    textures.add(spec, "road", textures.asphalt(style.asphalt, rng), specular=0.1, shininess=0.3)
    textures.add(spec, "pavement", textures.paving(style.paving, 4, rng))
    textures.add(spec, "grass", textures.grass(rng))
    textures.add(spec, "leaves", textures.foliage(style.leaves, rng), repeat=(2, 2))
    red, green, blue = (int(c * 0.8) for c in style.leaves)
    textures.add(spec, "hedge", textures.foliage((red, green, blue), rng))
    for i, (wall, brick) in enumerate(zip(style.walls, style.brick, strict=True)):
        textures.add(spec, f"wall{i}", textures.storeys(wall, brick, rng))
        textures.add(spec, f"ground{i}", textures.ground_floor(wall, style.shops, rng))
    for i, colour in enumerate(style.roofs):
        textures.add(spec, f"roof{i}", textures.roof(colour, rng))
    spec.add_material(name="kerb", rgba=(0.62, 0.61, 0.58, 1))
    spec.add_material(name="marking", rgba=(0.86, 0.86, 0.84, 1))
    spec.add_material(name="bark", rgba=(0.27, 0.2, 0.14, 1))
    spec.add_material(name="metal", rgba=(0.33, 0.35, 0.36, 1), specular=0.4)
    spec.add_material(name="street_lamp", rgba=(0.9, 0.88, 0.78, 1))
    spec.add_material(name="window_light", rgba=(0.24, 0.29, 0.33, 1), specular=0.6)


def _ground(spec: mujoco.MjSpec, town: Town) -> None:
    length = END_X - START_X
    lawn, road, pavement, kerb = Mesh(), Mesh(), Mesh(), Mesh()
    lawn.quad((START_X - 80, -120, -0.06), (length + 160, 0, 0), (0, 240, 0), (0, 0, 96, 60), cell=20)
    right = ROAD_HALF_WIDTH + (BAY_DEPTH if town.bus_bay else 0)
    road.quad(
        (START_X, -right, 0), (length, 0, 0), (0, right + ROAD_HALF_WIDTH, 0), (0, 0, length / 5, (right + ROAD_HALF_WIDTH) / 5), cell=1.6
    )
    for side, x0, x1, edge in _pavement_strips(town):
        inner, outer = side * edge, side * (edge + PAVEMENT_WIDTH)
        low, high = min(inner, outer), max(inner, outer)
        pavement.quad((x0, low, KERB_HEIGHT), (x1 - x0, 0, 0), (0, high - low, 0), (0, 0, (x1 - x0) / 2, (high - low) / 2), cell=1.6)
        for x in (x0, x1) if town.bus_bay and side < 0 else ():
            kerb.quad((x, high, -0.05), (0, low - high, 0), (0, 0, KERB_HEIGHT + 0.05), (0, 0, 1, 1))
        kerb.quad(
            (x1, inner, -0.02) if side > 0 else (x0, inner, -0.02), (-side * (x1 - x0), 0, 0), (0, 0, KERB_HEIGHT + 0.02), (0, 0, 1, 1)
        )
        kerb.quad((x0, inner if side > 0 else inner - 0.18, KERB_HEIGHT + 0.004), (x1 - x0, 0, 0), (0, 0.18, 0), (0, 0, 1, 1), cell=2)
    for name, mesh, material in (
        ("lawn", lawn, "grass"),
        ("road", road, "road"),
        ("pavement", pavement, "pavement"),
        ("kerb", kerb, "kerb"),
    ):
        mesh.add_to(spec, name)
        place(spec, name, material)


def _pavement_strips(town: Town) -> list[tuple[int, float, float, float]]:
    """Side, from x, to x, distance of the kerb from the road's centre."""
    strips = [(1, START_X, END_X, ROAD_HALF_WIDTH)]
    if town.bus_bay is None:
        return [*strips, (-1, START_X, END_X, ROAD_HALF_WIDTH)]
    first, last = town.bus_bay
    before, after = (-1, START_X, first, ROAD_HALF_WIDTH), (-1, last, END_X, ROAD_HALF_WIDTH)
    # Behind the strips beside the bay lies more pavement, so that no lawn shows between bay and houses.
    behind = (-1, START_X, END_X, ROAD_HALF_WIDTH + BAY_DEPTH)
    return [*strips, before, after, behind]


def _markings(spec: mujoco.MjSpec, rng: np.random.Generator) -> None:
    lines = Mesh()
    for x in np.arange(START_X + 2, END_X - 4, 9.0):
        lines.quad((x, -0.07, 0.006), (4.5, 0, 0), (0, 0.14, 0), (0, 0, 1, 1), cell=1.5)
    for y in (-ROAD_HALF_WIDTH + 0.25, ROAD_HALF_WIDTH - 0.37):
        lines.quad((START_X, y, 0.006), (END_X - START_X, 0, 0), (0, 0.12, 0), (0, 0, 1, 1), cell=2)
    crossing = float(rng.choice([-38.0, 34.0, 48.0]))
    for y in np.arange(-ROAD_HALF_WIDTH + 0.5, ROAD_HALF_WIDTH - 0.6, 1.0):
        lines.quad((crossing, y, 0.007), (3.0, 0, 0), (0, 0.5, 0), (0, 0, 1, 1), cell=1.5)
    lines.add_to(spec, "markings")
    place(spec, "markings", "marking")


def _front(town: Town, style: Style, side: int) -> float:
    """Distance of the house fronts from the road's centre."""
    kerb = ROAD_HALF_WIDTH + (BAY_DEPTH if town.bus_bay and side < 0 else 0)
    return kerb + PAVEMENT_WIDTH + style.setback + (2.5 if town.vegetation else 0)


def _buildings(spec: mujoco.MjSpec, town: Town, style: Style, side: int, rng: np.random.Generator) -> None:
    """House fronts, gable ends and roofs, one mesh a surface; closed at the end of the street by a cross row."""
    parts: dict[str, Mesh] = {}
    panes = Mesh()
    x, front = START_X - 10, _front(town, style, side)
    while x < END_X:
        width = rng.uniform(*style.widths)
        wall, floors = int(rng.integers(len(style.walls))), int(rng.integers(style.storeys[0], style.storeys[1] + 1))
        y = front + rng.uniform(0, 1.2)
        _house(parts, style, (x, x + width), (side * y, side * (y + 10)), wall, floors, int(rng.integers(len(style.roofs))))
        for _ in range(floors):
            window = x + 0.9 + 3 * rng.integers(max(1, int(width / 3)))
            height = 3.5 + 3 * rng.integers(floors) + 0.75
            u = (1.2, 0, 0) if side > 0 else (-1.2, 0, 0)
            panes.quad((window + (0 if side > 0 else 1.2), side * (y - 0.02), height), u, (0, 0, 1.5), (0, 0, 1, 1))
        x += width + style.gap + (rng.uniform(3, 8) if rng.random() < 0.2 else 0)
    if side > 0:
        for k, y in enumerate((-26.0, -9.0, 8.0)):
            _house(parts, style, (END_X + 22, END_X + 34), (y, y + 16.5), k % len(style.walls), style.storeys[1], k % len(style.roofs))
    for name, mesh in parts.items():
        mesh.add_to(spec, f"{name}_{side}")
        place(spec, f"{name}_{side}", name)
    panes.add_to(spec, f"panes_{side}")
    place(spec, f"panes_{side}", "window_light")


def _house(
    parts: dict[str, Mesh], style: Style, xs: tuple[float, float], ys: tuple[float, float], wall: int, floors: int, roof: int
) -> None:
    (x0, x1), y0, y1 = xs, min(ys), max(ys)
    eaves = 3.5 + 3.0 * floors
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        edge, length = (bx - ax, by - ay, 0.0), float(np.hypot(bx - ax, by - ay))
        bays = max(1, round(length / 3)) / 2
        parts.setdefault(f"ground{wall}", Mesh()).quad((ax, ay, 0), edge, (0, 0, 3.5), (0, 1, bays * 6 / 14, 0))
        parts.setdefault(f"wall{wall}", Mesh()).quad((ax, ay, 3.5), edge, (0, 0, 3.0 * floors), (0, floors / 2, bays, 0))
    surface = parts.setdefault(f"roof{roof}", Mesh())
    middle, ridge = (y0 + y1) / 2, eaves + 0.32 * (y1 - y0)
    span, slope = x1 - x0 + 0.8, np.hypot(middle - y0, ridge - eaves)
    surface.quad((x0 - 0.4, y0 - 0.4, eaves - 0.2), (span, 0, 0), (0, middle - y0 + 0.4, ridge - eaves + 0.2), (0, 0, span / 4, slope / 4))
    surface.quad((x1 + 0.4, y1 + 0.4, eaves - 0.2), (-span, 0, 0), (0, middle - y1 - 0.4, ridge - eaves + 0.2), (0, 0, span / 4, slope / 4))
    gable = parts[f"ground{wall}"]
    gable.triangle([(x0, y1, eaves), (x0, y0, eaves), (x0, middle, ridge)], [(0.02, 0.1), (0.06, 0.1), (0.04, 0.02)])
    gable.triangle([(x1, y0, eaves), (x1, y1, eaves), (x1, middle, ridge)], [(0.02, 0.1), (0.06, 0.1), (0.04, 0.02)])


def _trees(spec: mujoco.MjSpec, town: Town, style: Style, side: int, rng: np.random.Generator) -> None:
    kerb = ROAD_HALF_WIDTH + (BAY_DEPTH if town.bus_bay and side < 0 else 0)
    y = side * (kerb + PAVEMENT_WIDTH + (1.2 if town.vegetation else -0.6))
    spacing = 7.5 if town.vegetation else 19.0
    if side < 0:
        _crowns(spec, rng)
    for i, x in enumerate(np.arange(START_X + rng.uniform(0, spacing), END_X, spacing)):
        height = rng.uniform(2.3, 3.1)
        place_y = y + rng.uniform(-0.4, 0.4)
        spec.worldbody.add_geom(
            type=GEOM.mjGEOM_CAPSULE, fromto=(x, place_y, 0, x, place_y, height + 0.8), size=(rng.uniform(0.1, 0.17), 0, 0), material="bark"
        )
        angle = rng.uniform(0, 2 * np.pi)
        spec.worldbody.add_geom(
            type=GEOM.mjGEOM_MESH, meshname=f"crown{i % 3}", pos=(x, place_y, height + rng.uniform(1.3, 1.7)),
            quat=(np.cos(angle / 2), 0, 0, np.sin(angle / 2)), material="leaves", castshadow=i % 2 == 0,
        )  # fmt: skip
    if town.vegetation:
        hedge = Mesh()
        for x in np.arange(START_X, END_X, 9.0):
            top, inner, outer = rng.uniform(0.9, 1.5), y - side * 0.2, y + side * 1.1
            low, high = min(inner, outer), max(inner, outer)
            hedge.quad((x, low, top), (8.2, 0, 0), (0, high - low, 0), (0, 0, 4, 0.7), cell=2)
            face = (x, inner, 0) if side > 0 else (x + 8.2, inner, 0)
            hedge.quad(face, (side * 8.2, 0, 0), (0, 0, top), (0, 1, 4, 0.3), cell=2)
            hedge.quad((x, high, 0), (0, low - high, 0), (0, 0, top), (0, 1, 0.7, 0.3))
        hedge.add_to(spec, f"hedge_{side}")
        place(spec, f"hedge_{side}", "hedge")


def _crowns(spec: mujoco.MjSpec, rng: np.random.Generator) -> None:
    """Three lumpy crowns: rings of a sphere whose radius wobbles."""
    for i in range(3):
        rings, points = 8, 12
        latitude = np.linspace(-0.48 * np.pi, 0.48 * np.pi, rings)
        around = np.linspace(0, 2 * np.pi, points, endpoint=False)
        radius = rng.uniform(0.82, 1.18, (rings, points)) * rng.uniform(1.5, 2.0)
        circle = np.stack([np.cos(around), np.sin(around)], -1)
        rows = [
            np.column_stack([circle * (radius[k] * np.cos(latitude[k]))[:, None], 0.85 * radius[k] * np.sin(latitude[k])])
            for k in range(rings)
        ]
        loft(spec, f"crown{i}", rows)


def _furniture(spec: mujoco.MjSpec, town: Town, style: Style, rng: np.random.Generator) -> None:
    world = spec.worldbody
    for x, y, z in lamp_positions(town):
        side = np.sign(y)
        foot = side * (ROAD_HALF_WIDTH + 0.5 + (BAY_DEPTH if town.bus_bay and side < 0 and town.bus_bay[0] < x < town.bus_bay[1] else 0))
        world.add_geom(type=GEOM.mjGEOM_CAPSULE, fromto=(x, foot, 0, x, foot, z), size=(0.07, 0, 0), material="metal", castshadow=False)
        world.add_geom(type=GEOM.mjGEOM_CAPSULE, fromto=(x, foot, z, x, y, z + 0.15), size=(0.04, 0, 0), material="metal", castshadow=False)
        world.add_geom(type=GEOM.mjGEOM_BOX, size=(0.3, 0.16, 0.06), pos=(x, y, z + 0.12), material="street_lamp", castshadow=False)
    for _ in range(6):
        x, side = rng.uniform(START_X, END_X), rng.choice([-1, 1])
        y = side * (ROAD_HALF_WIDTH + PAVEMENT_WIDTH - 0.5 + (BAY_DEPTH if town.bus_bay and side < 0 else 0))
        if rng.random() < 0.5:
            world.add_geom(type=GEOM.mjGEOM_CYLINDER, size=(0.22, 0.42, 0), pos=(x, y, 0.55), material="metal", castshadow=False)
        else:
            world.add_geom(type=GEOM.mjGEOM_BOX, size=(0.8, 0.22, 0.04), pos=(x, y, 0.55), material="bark", castshadow=False)
            world.add_geom(type=GEOM.mjGEOM_BOX, size=(0.8, 0.03, 0.2), pos=(x, y + side * 0.22, 0.85), material="bark", castshadow=False)
    for x in (START_X + 30, 8.0, 70.0):
        pole = -(ROAD_HALF_WIDTH + 0.4)
        world.add_geom(type=GEOM.mjGEOM_CAPSULE, fromto=(x, pole, 0, x, pole, 2.3), size=(0.035, 0, 0), material="metal", castshadow=False)
        facing = (np.sqrt(0.5), 0, np.sqrt(0.5), 0)
        world.add_geom(
            type=GEOM.mjGEOM_CYLINDER, size=(0.3, 0.015, 0), pos=(x, pole, 2.5), quat=facing, rgba=(0.75, 0.06, 0.08, 1), castshadow=False
        )
        world.add_geom(
            type=GEOM.mjGEOM_CYLINDER,
            size=(0.22, 0.02, 0),
            pos=(x - 0.01, pole, 2.5),
            quat=facing,
            rgba=(0.93, 0.93, 0.92, 1),
            castshadow=False,
        )
    if town.bus_bay:
        _bus_stop(world, town.bus_bay)


def _bus_stop(world: mujoco.MjsBody, bay: tuple[float, float]) -> None:
    x, y = bay[0] + 0.35 * (bay[1] - bay[0]), -(ROAD_HALF_WIDTH + BAY_DEPTH + 1.9)
    world.add_geom(type=GEOM.mjGEOM_BOX, size=(2.0, 0.75, 0.05), pos=(x, y, 2.5), material="metal", castshadow=False)
    world.add_geom(type=GEOM.mjGEOM_BOX, size=(2.0, 0.03, 1.0), pos=(x, y - 0.7, 1.3), rgba=(0.45, 0.55, 0.58, 1), castshadow=False)
    for dx in (-1.95, 1.95):
        world.add_geom(type=GEOM.mjGEOM_BOX, size=(0.04, 0.7, 1.2), pos=(x + dx, y, 1.3), rgba=(0.45, 0.55, 0.58, 1), castshadow=False)
    world.add_geom(type=GEOM.mjGEOM_BOX, size=(1.4, 0.2, 0.04), pos=(x, y - 0.4, 0.6), material="bark", castshadow=False)
