"""Builds the streets of a town: road, pavements, buildings, vegetation, street furniture.

Each street is a body of the model and everything is placed in its frame: u along the street, v to its left, z up, metres.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np

from pipeline.layout import CORNER_RADIUS, END_X, LANE_WIDTH, PAVEMENT_WIDTH, START_X, Street, Town, streets

from . import textures
from .mesh import Mesh, loft, place

GEOM = mujoco.mjtGeom
KERB_HEIGHT = 0.12
LAMP_SPACING = 22.0
HOUSE_DEPTH = 10.0
LAWN_Z, ROAD_Z, LINE_Z = -0.06, 0.0, 0.006


@dataclass(frozen=True)
class Style:
    """What makes a town look like itself."""

    walls: tuple[textures.Colour, ...]
    brick: tuple[bool, ...]
    roofs: tuple[textures.Colour, ...]
    asphalt: int
    paving: textures.Colour
    leaves: textures.Colour
    conical: bool
    storeys: tuple[int, int]
    widths: tuple[float, float]
    gap: float
    setback: float
    shops: bool
    lamp_reach: float
    lamp_height: float


STYLES = {
    "urban": Style(
        walls=((178, 112, 88), (204, 190, 162), (150, 150, 154), (214, 200, 160), (132, 88, 72)),
        brick=(True, False, False, False, True),
        roofs=((96, 58, 48), (74, 74, 80)),
        asphalt=74,
        paving=(150, 147, 140),
        leaves=(62, 92, 44),
        conical=False,
        storeys=(2, 5),
        widths=(11.0, 18.0),
        gap=0.25,
        setback=1.6,
        shops=True,
        lamp_reach=1.5,
        lamp_height=6.2,
    ),
    "suburban": Style(
        walls=((226, 218, 200), (196, 150, 120), (170, 182, 186), (232, 226, 214)),
        brick=(False, True, False, False),
        roofs=((126, 70, 54), (88, 72, 64)),
        asphalt=92,
        paving=(128, 122, 118),
        leaves=(84, 106, 46),
        conical=True,
        storeys=(1, 2),
        widths=(9.0, 13.0),
        gap=5.0,
        setback=6.0,
        shops=False,
        lamp_reach=0.6,
        lamp_height=5.2,
    ),
}


def lamp_positions(town: Town) -> np.ndarray:
    """(n, 3) metres in the world: where the street lamps' light comes from."""
    style = STYLES[town.style]
    return np.array(
        [(*street.world(u, side * (street.edge(side, u) + 0.5 - style.lamp_reach)), style.lamp_height) for street, u, side in _lamps(town)]
    )


def _lamps(town: Town) -> Iterator[tuple[Street, float, int]]:
    """Street, place along it and side of each lamp, on alternating sides."""
    for street in streets(town):
        for i, u in enumerate(np.arange(street.start + (9 if street.name == "main" else CORNER_RADIUS + 3), street.end, LAMP_SPACING)):
            side = 1 if i % 2 else -1
            if not street.open(side, float(u), margin=0.5):
                yield street, float(u), side


def add(spec: mujoco.MjSpec, town: Town) -> None:
    """Add the streets to an empty model."""
    rng = np.random.default_rng([7, town.seed])
    style = STYLES[town.style]
    _declare_surfaces(spec, style, rng)
    _crowns(spec, style, rng)
    _lawn(spec)
    for street in streets(town):
        body = spec.worldbody.add_body(
            name=f"street_{street.name}", pos=(*street.origin, 0), quat=(np.cos(street.angle / 2), 0, 0, np.sin(street.angle / 2))
        )
        _ground(spec, body, street)
        _markings(spec, body, town, street, rng)
        for side in (-1, 1):
            _buildings(spec, body, town, street, side, rng)
            _vegetation(spec, body, town, street, side, rng)
        _furniture(body, town, street, rng)
    for i, (x, y) in enumerate(town.trees):
        _tree(spec.worldbody, x, y, i, rng)
    if town.rails_x_m is not None:
        _rails(spec, town, town.rails_x_m)


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
    spec.add_material(name="kerb", rgba=(0.48, 0.47, 0.45, 1))
    spec.add_material(name="marking", rgba=(0.86, 0.86, 0.84, 1))
    spec.add_material(name="gravel", rgba=(0.42, 0.4, 0.37, 1))
    spec.add_material(name="bark", rgba=(0.27, 0.2, 0.14, 1))
    spec.add_material(name="metal", rgba=(0.33, 0.35, 0.36, 1), specular=0.4)
    spec.add_material(name="street_lamp", rgba=(0.9, 0.88, 0.78, 1))
    spec.add_material(name="window_light", rgba=(0.24, 0.29, 0.33, 1), specular=0.6)


def _lawn(spec: mujoco.MjSpec) -> None:
    lawn, reach = Mesh(), END_X - START_X + 160
    lawn.quad((START_X - 80, -120, LAWN_Z), (reach, 0, 0), (0, 240, 0), (0, 0, 96, 60), cell=20)
    lawn.add_to(spec, "lawn")
    place(spec.worldbody, "lawn", "grass")


def _ground(spec: mujoco.MjSpec, body: mujoco.MjsBody, street: Street) -> None:
    length, right, left = street.end - street.start, street.edge(-1), street.left
    road, pavement, kerb = Mesh(), Mesh(), Mesh()
    window = (0, 0, length / 5, (right + left) / 5)
    road.quad((street.start, -right, ROAD_Z), (length, 0, 0), (0, right + left, 0), window, cell=1.6)
    for side in (-1, 1):
        for u0, u1, edge in _pavement_strips(street, side):
            _kerbed(pavement, kerb, side, u0, u1, edge)
        for gap in street.gaps:
            if gap.side == side and gap.mouth:
                for corner, inwards in ((gap.start, 1), (gap.end, -1)):
                    _corner(road, pavement, kerb, corner, side * street.edge(side), inwards, side)
    for name, mesh, material in (("road", road, "road"), ("pavement", pavement, "pavement"), ("kerb", kerb, "kerb")):
        mesh.add_to(spec, f"{street.name}_{name}")
        place(body, f"{street.name}_{name}", material)


def _pavement_strips(street: Street, side: int) -> Iterator[tuple[float, float, float]]:
    """From u, to u, distance of the kerb from the axis."""
    start = street.start if street.name == "main" else CORNER_RADIUS
    cuts = sorted((gap.start, gap.end) for gap in street.gaps if gap.side == side)
    if side < 0 and street.bay:
        cuts = sorted([*cuts, street.bay])
        # Behind the strips beside the bay lies more pavement, so that no lawn shows between bay and houses.
        outer = sorted((gap.start, gap.end) for gap in street.gaps if gap.side == side)
        for u0, u1 in _between(start, street.end, outer):
            yield u0, u1, street.edge(-1)
    for u0, u1 in _between(start, street.end, cuts):
        yield u0, u1, street.right if side < 0 else street.left


def _between(start: float, end: float, cuts: list[tuple[float, float]]) -> Iterator[tuple[float, float]]:
    """What is left of [start, end] without the cuts."""
    for low, high in cuts:
        if low > start:
            yield start, low
        start = max(start, high)
    if end > start:
        yield start, end


def _kerbed(pavement: Mesh, kerb: Mesh, side: int, u0: float, u1: float, edge: float) -> None:
    """A strip of pavement with its kerbstone and the upright faces towards the road and at both ends."""
    inner, outer = side * edge, side * (edge + PAVEMENT_WIDTH)
    low, high = min(inner, outer), max(inner, outer)
    pavement.quad((u0, low, KERB_HEIGHT), (u1 - u0, 0, 0), (0, high - low, 0), (0, 0, (u1 - u0) / 2, (high - low) / 2), cell=1.6)
    up = (0, 0, KERB_HEIGHT + 0.05)
    kerb.quad((u0, inner, -0.05) if side > 0 else (u1, inner, -0.05), (side * (u1 - u0), 0, 0), up, (0, 0, 1, 1))
    kerb.quad((u0, inner if side > 0 else inner - 0.18, KERB_HEIGHT + 0.004), (u1 - u0, 0, 0), (0, 0.18, 0), (0, 0, 1, 1), cell=2)
    kerb.quad((u0, high, -0.05), (0, low - high, 0), up, (0, 0, 1, 1))
    kerb.quad((u1, low, -0.05), (0, high - low, 0), up, (0, 0, 1, 1))


def _corner(road: Mesh, pavement: Mesh, kerb: Mesh, u: float, v: float, inwards: int, side: int) -> None:
    """The rounded corner where a side street begins: asphalt in the square, pavement in the quarter disc around its far corner.

    u, v: where the kerb of this street ends. inwards: 1 if the mouth lies at larger u. side: of the side street.
    """
    low_u, low_v = min(u, u + inwards * CORNER_RADIUS), min(v, v + side * CORNER_RADIUS)
    road.quad((low_u, low_v, ROAD_Z), (CORNER_RADIUS, 0, 0), (0, CORNER_RADIUS, 0), (0, 0, 1.2, 1.2), cell=1.6)
    centre = np.array([u, v + side * CORNER_RADIUS, KERB_HEIGHT])
    angles = np.linspace(0, np.pi / 2, 9)
    arc = centre + CORNER_RADIUS * np.stack([inwards * np.sin(angles), -side * np.cos(angles), 0 * angles], -1)
    turn = inwards * side > 0
    for a, b in pairwise(arc):
        first, second = (a, b) if turn else (b, a)
        pavement.triangle([centre, first, second], [point[:2] / 2 for point in (centre, first, second)])
        kerb.quad(first - (0, 0, KERB_HEIGHT + 0.05), second - first, (0, 0, KERB_HEIGHT + 0.05), (0, 0, 1, 1))
        inner_a, inner_b = (centre + (point - centre) * (1 - 0.18 / CORNER_RADIUS) + (0, 0, 0.004) for point in (first, second))
        lift = np.array((0, 0, 0.004))
        kerb.triangle([inner_a, first + lift, second + lift], np.zeros((3, 2)))
        kerb.triangle([inner_a, second + lift, inner_b], np.zeros((3, 2)))


def _markings(spec: mujoco.MjSpec, body: mujoco.MjsBody, town: Town, street: Street, rng: np.random.Generator) -> None:
    lines = Mesh()
    start = street.start + 2 if street.name == "main" else CORNER_RADIUS

    def dashes(v: float, u0: float, u1: float) -> None:
        for u in np.arange(u0, u1 - 4, 9.0):
            lines.quad((u, v - 0.07, LINE_Z), (4.5, 0, 0), (0, 0.14, 0), (0, 0, 1, 1), cell=1.5)

    def solid(v: float, u0: float, u1: float) -> None:
        lines.quad((u0, v - 0.06, LINE_Z), (u1 - u0, 0, 0), (0, 0.12, 0), (0, 0, 1, 1), cell=2)

    mouths = sorted((gap.start, gap.end) for gap in street.gaps if gap.mouth)
    for u0, u1 in _between(start, street.end, mouths):
        if town.lanes_ahead == 2 and street.name == "main":
            solid(street.middle, u0, u1)
            dashes(0, u0, u1)
        else:
            dashes(street.middle, u0, u1)
    for side in (-1, 1):
        for u0, u1 in _between(start, street.end, [(g.start, g.end) for g in street.gaps if g.side == side and g.mouth]):
            solid(side * ((street.right if side < 0 else street.left) - 0.31), u0, u1)
    if street.name == "side":  # Give way: short bars across the lane that comes out.
        for v in np.arange(0.35, LANE_WIDTH - 0.4, 0.75):
            lines.quad((0.4, v, LINE_Z), (0.4, 0, 0), (0, 0.45, 0), (0, 0, 1, 1))
    crosswalks = [crosswalk.at_m for crosswalk in town.crosswalks if crosswalk.street == street.name]
    if street.name == "main" and not crosswalks and not street.gaps:
        crosswalks = [float(rng.choice([-38.0, 34.0, 48.0])) + 1.5]
    for at in crosswalks:
        for v in np.arange(-street.right + 0.5, street.left - 0.6, 1.0):
            lines.quad((at - 1.5, v, LINE_Z + 0.001), (3.0, 0, 0), (0, 0.5, 0), (0, 0, 1, 1), cell=1.5)
    lines.add_to(spec, f"{street.name}_markings")
    place(body, f"{street.name}_markings", "marking")


def _front(town: Town, style: Style, street: Street, side: int) -> float:
    """Distance of the house fronts from the axis."""
    return street.edge(side) + PAVEMENT_WIDTH + style.setback + (2.5 if town.overgrown(side) else 0)


def _buildings(spec: mujoco.MjSpec, body: mujoco.MjsBody, town: Town, street: Street, side: int, rng: np.random.Generator) -> None:
    """House fronts, gable ends and roofs, one mesh a surface; a cross row closes the street at its end."""
    style = STYLES[town.style]
    parts: dict[str, Mesh] = {}
    panes = Mesh()
    front = _front(town, style, street, side)
    # The main street's corner houses stand at the side street; its own begin behind them.
    u = street.start - 10 if street.name == "main" else PAVEMENT_WIDTH + style.setback + HOUSE_DEPTH + 4
    clear = PAVEMENT_WIDTH + style.setback - CORNER_RADIUS + 0.5
    while u < street.end:
        width = rng.uniform(*style.widths)
        wall, floors = int(rng.integers(len(style.walls))), int(rng.integers(style.storeys[0], style.storeys[1] + 1))
        gap = next((g for g in street.gaps if g.side == side and g.start - clear < u + width and u < g.end + clear), None)
        if gap:
            u = gap.end + clear if u + 8 > gap.start - clear else u
            if u < gap.start:
                width = gap.start - clear - u
        v = front + rng.uniform(0, 1.2)
        _house(parts, style, (u, u + width), (side * v, side * (v + HOUSE_DEPTH)), wall, floors, int(rng.integers(len(style.roofs))))
        for _ in range(floors):
            window = u + 0.9 + 3 * rng.integers(max(1, int(width / 3)))
            height = 3.5 + 3 * rng.integers(floors) + 0.75
            edge = (1.2, 0, 0) if side > 0 else (-1.2, 0, 0)
            panes.quad((window + (0 if side > 0 else 1.2), side * (v - 0.02), height), edge, (0, 0, 1.5), (0, 0, 1, 1))
        u += width + style.gap + (rng.uniform(3, 8) if rng.random() < 0.2 else 0)
    if side > 0:
        behind = street.end + (22 if street.name == "main" else 8)
        for k, v in enumerate((-26.0, -9.0, 8.0)):
            _house(parts, style, (behind, behind + 12), (v, v + 16.5), k % len(style.walls), style.storeys[1], k % len(style.roofs))
    for name, mesh in [*parts.items(), ("window_light", panes)]:
        mesh.add_to(spec, f"{street.name}_{name}_{side}")
        place(body, f"{street.name}_{name}_{side}", name)


def _house(
    parts: dict[str, Mesh], style: Style, us: tuple[float, float], vs: tuple[float, float], wall: int, floors: int, roof: int
) -> None:
    (x0, x1), y0, y1 = us, min(vs), max(vs)
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


def _vegetation(spec: mujoco.MjSpec, body: mujoco.MjsBody, town: Town, street: Street, side: int, rng: np.random.Generator) -> None:
    dense = town.overgrown(side)
    v = side * (street.edge(side) + PAVEMENT_WIDTH + (1.2 if dense else -0.6))
    spacing = 7.5 if dense else 19.0
    start = street.start if street.name == "main" else CORNER_RADIUS + 4
    for i, u in enumerate(np.arange(start + rng.uniform(0, spacing), street.end, spacing)):
        if not street.open(side, float(u), margin=2):
            _tree(body, float(u), v + rng.uniform(-0.4, 0.4), i, rng)
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
    hedge.add_to(spec, f"{street.name}_hedge_{side}")
    place(body, f"{street.name}_hedge_{side}", "hedge")


def _tree(body: mujoco.MjsBody, u: float, v: float, i: int, rng: np.random.Generator) -> None:
    height, angle = rng.uniform(2.3, 3.1), rng.uniform(0, 2 * np.pi)
    body.add_geom(type=GEOM.mjGEOM_CAPSULE, fromto=(u, v, 0, u, v, height + 0.8), size=(rng.uniform(0.1, 0.17), 0, 0), material="bark")
    body.add_geom(
        type=GEOM.mjGEOM_MESH, meshname=f"crown{i % 3}", pos=(u, v, height + rng.uniform(1.3, 1.7)),
        quat=(np.cos(angle / 2), 0, 0, np.sin(angle / 2)), material="leaves", castshadow=i % 2 == 0,
    )  # fmt: skip


def _crowns(spec: mujoco.MjSpec, style: Style, rng: np.random.Generator) -> None:
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
            np.column_stack([circle * (radius[k] * width[k])[:, None], np.full(points, radius[k].mean() * lift[k])]) for k in range(rings)
        ]
        loft(spec, f"crown{i}", rows)


def _furniture(body: mujoco.MjsBody, town: Town, street: Street, rng: np.random.Generator) -> None:
    style = STYLES[town.style]
    for owner, u, side in _lamps(town):
        if owner.name == street.name:
            _lamp(body, style, street, u, side)
    for _ in range(6):
        u, side = float(rng.uniform(street.start + CORNER_RADIUS, street.end)), int(rng.choice([-1, 1]))
        v = side * (street.edge(side) + PAVEMENT_WIDTH - 0.5)
        if street.open(side, u, margin=1):
            continue
        if rng.random() < 0.5:
            body.add_geom(type=GEOM.mjGEOM_CYLINDER, size=(0.22, 0.42, 0), pos=(u, v, 0.55), material="metal", castshadow=False)
        else:
            body.add_geom(type=GEOM.mjGEOM_BOX, size=(0.8, 0.22, 0.04), pos=(u, v, 0.55), material="bark", castshadow=False)
            body.add_geom(type=GEOM.mjGEOM_BOX, size=(0.8, 0.03, 0.2), pos=(u, v + side * 0.22, 0.85), material="bark", castshadow=False)
    for u in (START_X + 30, 8.0, 70.0) if street.name == "main" else (30.0,):
        if not street.open(-1, u, margin=1) and not (street.bay and street.bay[0] < u < street.bay[1]):
            _sign(body, u, -(street.right + 0.4))
    if street.bay:
        _bus_stop(body, street, street.bay)


def _lamp(body: mujoco.MjsBody, style: Style, street: Street, u: float, side: int) -> None:
    foot, z = side * (street.edge(side, u) + 0.5), style.lamp_height
    v = foot - side * style.lamp_reach
    body.add_geom(type=GEOM.mjGEOM_CAPSULE, fromto=(u, foot, 0, u, foot, z), size=(0.07, 0, 0), material="metal", castshadow=False)
    body.add_geom(type=GEOM.mjGEOM_CAPSULE, fromto=(u, foot, z, u, v, z + 0.15), size=(0.04, 0, 0), material="metal", castshadow=False)
    if style.lamp_reach > 1:
        body.add_geom(type=GEOM.mjGEOM_BOX, size=(0.3, 0.16, 0.06), pos=(u, v, z + 0.12), material="street_lamp", castshadow=False)
    else:
        body.add_geom(type=GEOM.mjGEOM_SPHERE, size=(0.2, 0, 0), pos=(u, v, z), material="street_lamp", castshadow=False)


def _sign(body: mujoco.MjsBody, u: float, v: float) -> None:
    facing = (np.sqrt(0.5), 0, np.sqrt(0.5), 0)
    body.add_geom(type=GEOM.mjGEOM_CAPSULE, fromto=(u, v, 0, u, v, 2.3), size=(0.035, 0, 0), material="metal", castshadow=False)
    for du, radius, rgba in ((0.0, 0.3, (0.75, 0.06, 0.08, 1)), (-0.01, 0.22, (0.93, 0.93, 0.92, 1))):
        size = (radius, 0.015 - du / 2, 0)
        body.add_geom(type=GEOM.mjGEOM_CYLINDER, size=size, pos=(u + du, v, 2.5), quat=facing, rgba=rgba, castshadow=False)


def _bus_stop(body: mujoco.MjsBody, street: Street, bay: tuple[float, float]) -> None:
    u, v = bay[0] + 0.35 * (bay[1] - bay[0]), -(street.edge(-1) + 1.9)
    glass = (0.45, 0.55, 0.58, 1)
    body.add_geom(type=GEOM.mjGEOM_BOX, size=(2.0, 0.75, 0.05), pos=(u, v, 2.5), material="metal", castshadow=False)
    body.add_geom(type=GEOM.mjGEOM_BOX, size=(2.0, 0.03, 1.0), pos=(u, v - 0.7, 1.3), rgba=glass, castshadow=False)
    for du in (-1.95, 1.95):
        body.add_geom(type=GEOM.mjGEOM_BOX, size=(0.04, 0.7, 1.2), pos=(u + du, v, 1.3), rgba=glass, castshadow=False)
    body.add_geom(type=GEOM.mjGEOM_BOX, size=(1.4, 0.2, 0.04), pos=(u, v - 0.4, 0.6), material="bark", castshadow=False)


def _rails(spec: mujoco.MjSpec, town: Town, x: float) -> None:
    """A train line across the main street: gravel beside the road, two rails, and a St Andrew's cross on either approach."""
    world, main = spec.worldbody, streets(town)[0]
    gravel = Mesh()
    for low, high in ((-60.0, -main.right), (main.left, 60.0)):
        gravel.quad((x - 2.2, low, 0.03), (4.4, 0, 0), (0, high - low, 0), (0, 0, 1, 1), cell=2)
    gravel.add_to(spec, "gravel")
    place(world, "gravel", "gravel")
    for dx in (-0.72, 0.72):
        world.add_geom(type=GEOM.mjGEOM_BOX, size=(0.04, 60, 0.02), pos=(x + dx, 0, 0.0), rgba=(0.5, 0.46, 0.43, 1), castshadow=False)
        for low, high in ((-60.0, -main.right), (main.left, 60.0)):
            world.add_geom(
                type=GEOM.mjGEOM_BOX, size=(0.04, (high - low) / 2, 0.06), pos=(x + dx, (low + high) / 2, 0.1), rgba=(0.5, 0.46, 0.43, 1),
                castshadow=False,
            )  # fmt: skip
    for px, v in ((x - 4, -(main.right + 0.6)), (x + 4, main.left + 0.6)):
        world.add_geom(type=GEOM.mjGEOM_CAPSULE, fromto=(px, v, 0, px, v, 2.6), size=(0.045, 0, 0), material="metal", castshadow=False)
        for tilt in (np.pi / 8, -np.pi / 8):
            world.add_geom(
                type=GEOM.mjGEOM_BOX, size=(0.02, 0.6, 0.08), pos=(px - 0.06, v, 2.5), quat=(np.cos(tilt), np.sin(tilt), 0, 0),
                rgba=(0.9, 0.2, 0.15, 1), castshadow=False,
            )  # fmt: skip
