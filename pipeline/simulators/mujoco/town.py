"""Builds the streets of a town: ground, kerbs and markings here.

Houses, trees and furniture in their own modules.

Each street is a body of the model and everything is placed in its frame: u along the street, v to
its left, z up, metres. A curved street is built straight and then bent.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import mujoco
import numpy as np

from pipeline.scenarios.streets import (
    CORNER_RADIUS,
    CROSSWALK_M,
    END_X,
    LANE_WIDTH,
    PAVEMENT_WIDTH,
    START_X,
    Street,
    Town,
    streets,
)
from pipeline.simulators.mujoco import bending, buildings, furniture, textures, vegetation
from pipeline.simulators.mujoco.mesh import Mesh, Site, place
from pipeline.simulators.mujoco.style import STYLES, Style

Strip = tuple[float, float, float]
"""From u, to u, distance of the kerb from the axis."""
KERB_HEIGHT = 0.12
LAWN_Z, ROAD_Z, LINE_Z = -0.06, 0.0, 0.006


def add(spec: mujoco.MjSpec, town: Town) -> None:
    """Add the streets to an empty model."""
    rng = np.random.default_rng([7, town.seed])
    style = STYLES[town.style]
    _declare_surfaces(spec, style, rng)
    vegetation.declare_crowns(spec, style, rng)
    lawn, reach = Mesh(), END_X - START_X + 160
    lawn.quad((START_X - 80, -120, LAWN_Z), (reach, 0, 0), (0, 240, 0), (0, 0, 96, 60), cell=20)
    lawn.add_to(spec, "lawn")
    place(spec.worldbody, "lawn", "grass")
    for street in streets(town):
        body = spec.worldbody.add_body(
            name=f"street_{street.name}",
            pos=(*street.origin, 0),
            quat=(np.cos(street.angle / 2), 0, 0, np.sin(street.angle / 2)),
        )
        site = Site(spec, body)
        _ground(site, street)
        _markings(site, town, street, rng)
        for side in (-1, 1):
            buildings.add(site, town, street, side, rng)
            vegetation.add(site, town, street, side, rng)
        furniture.add(body, town, street, rng)
        if street.curvature:
            bending.bend(spec, body, street)
    for i, (x, y) in enumerate(town.trees):
        vegetation.add_tree(spec.worldbody, x, y, i, rng)
    if town.rails_x_m is not None:
        furniture.add_rails(spec, town, town.rails_x_m)


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


@dataclass(frozen=True)
class _Surfaces:
    """The meshes of a street's ground."""

    road: Mesh = field(default_factory=Mesh)
    pavement: Mesh = field(default_factory=Mesh)
    kerb: Mesh = field(default_factory=Mesh)


def _ground(site: Site, street: Street) -> None:
    length, right, left = street.end - street.start, street.edge(-1), street.left
    surfaces = _Surfaces()
    window = (0, 0, length / 5, (right + left) / 5)
    surfaces.road.quad(
        (street.start, -right, ROAD_Z), (length, 0, 0), (0, right + left, 0), window, cell=1.6
    )
    for side in (-1, 1):
        for strip in _pavement_strips(street, side):
            _kerbed(surfaces, side, strip, cell=1.6 if street.curvature else 4.0)
        for gap in street.gaps:
            if gap.side == side and gap.mouth:
                for corner, inwards in ((gap.start, 1), (gap.end, -1)):
                    _corner(surfaces, corner, side * street.edge(side), inwards, side)
    for name, mesh in (
        ("road", surfaces.road),
        ("pavement", surfaces.pavement),
        ("kerb", surfaces.kerb),
    ):
        site.put(f"{street.name}_{name}", mesh, name)


def _pavement_strips(street: Street, side: int) -> Iterator[Strip]:
    start = street.start if street.name == "main" else CORNER_RADIUS
    cuts = sorted((gap.start, gap.end) for gap in street.gaps if gap.side == side)
    if side < 0 and street.bay:
        cuts = sorted([*cuts, street.bay])
        # More pavement behind the strips beside the bay: no lawn shows between bay and houses.
        outer = sorted((gap.start, gap.end) for gap in street.gaps if gap.side == side)
        for u0, u1 in _between(start, street.end, outer):
            yield u0, u1, street.edge(-1)
    for u0, u1 in _between(start, street.end, cuts):
        yield u0, u1, street.right if side < 0 else street.left


def _between(
    start: float, end: float, cuts: list[tuple[float, float]]
) -> Iterator[tuple[float, float]]:
    """The parts of [start, end] without the cuts."""
    for low, high in cuts:
        if low > start:
            yield start, low
        start = max(start, high)
    if end > start:
        yield start, end


def _kerbed(surfaces: _Surfaces, side: int, strip: Strip, cell: float) -> None:
    """A strip of pavement with its kerbstone, in cells of `cell` metres.

    It has upright faces towards the road and at both ends.
    """
    pavement, kerb, (u0, u1, edge) = surfaces.pavement, surfaces.kerb, strip
    inner, outer = side * edge, side * (edge + PAVEMENT_WIDTH)
    low, high = min(inner, outer), max(inner, outer)
    pavement.quad(
        (u0, low, KERB_HEIGHT),
        (u1 - u0, 0, 0),
        (0, high - low, 0),
        (0, 0, (u1 - u0) / 2, (high - low) / 2),
        cell=1.6,
    )
    up = (0, 0, KERB_HEIGHT + 0.05)
    kerb.quad(
        (u0, inner, -0.05) if side > 0 else (u1, inner, -0.05),
        (side * (u1 - u0), 0, 0),
        up,
        (0, 0, 1, 1),
        cell=cell,
    )
    kerb.quad(
        (u0, inner if side > 0 else inner - 0.18, KERB_HEIGHT + 0.004),
        (u1 - u0, 0, 0),
        (0, 0.18, 0),
        (0, 0, 1, 1),
        cell=2,
    )
    kerb.quad((u0, high, -0.05), (0, low - high, 0), up, (0, 0, 1, 1))
    kerb.quad((u1, low, -0.05), (0, high - low, 0), up, (0, 0, 1, 1))


def _corner(surfaces: _Surfaces, u: float, v: float, inwards: int, side: int) -> None:
    """The rounded corner where a side street begins.

    Asphalt fills the square, pavement the quarter disc around its far corner.

    u, v: where the kerb of this street ends. inwards: 1 if the mouth lies at larger u. side: of the
    side street.
    """
    road, pavement, kerb = surfaces.road, surfaces.pavement, surfaces.kerb
    low_u, low_v = min(u, u + inwards * CORNER_RADIUS), min(v, v + side * CORNER_RADIUS)
    road.quad(
        (low_u, low_v, ROAD_Z),
        (CORNER_RADIUS, 0, 0),
        (0, CORNER_RADIUS, 0),
        (0, 0, 1.2, 1.2),
        cell=1.6,
    )
    centre = np.array([u, v + side * CORNER_RADIUS, KERB_HEIGHT])
    angles = np.linspace(0, np.pi / 2, 9)
    arc = centre + CORNER_RADIUS * np.stack(
        [inwards * np.sin(angles), -side * np.cos(angles), 0 * angles], -1
    )
    turn = inwards * side > 0
    for a, b in pairwise(arc):
        first, second = (a, b) if turn else (b, a)
        pavement.triangle(
            [centre, first, second], [point[:2] / 2 for point in (centre, first, second)]
        )
        kerb.quad(
            first - (0, 0, KERB_HEIGHT + 0.05),
            second - first,
            (0, 0, KERB_HEIGHT + 0.05),
            (0, 0, 1, 1),
        )
        inner_a, inner_b = (
            centre + (point - centre) * (1 - 0.18 / CORNER_RADIUS) + (0, 0, 0.004)
            for point in (first, second)
        )
        lift = np.array((0, 0, 0.004))
        kerb.triangle([inner_a, first + lift, second + lift], np.zeros((3, 2)))
        kerb.triangle([inner_a, second + lift, inner_b], np.zeros((3, 2)))


def _markings(site: Site, town: Town, street: Street, rng: np.random.Generator) -> None:
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
        for u0, u1 in _between(
            start, street.end, [(g.start, g.end) for g in street.gaps if g.side == side and g.mouth]
        ):
            solid(side * ((street.right if side < 0 else street.left) - 0.31), u0, u1)
    if street.name == "side":  # Give way: short bars across the lane that leaves the side street.
        for v in np.arange(0.35, LANE_WIDTH - 0.4, 0.75):
            lines.quad((0.4, v, LINE_Z), (0.4, 0, 0), (0, 0.45, 0), (0, 0, 1, 1))
    crosswalks = [
        crosswalk.at_m for crosswalk in town.crosswalks if crosswalk.street == street.name
    ]
    if street.name == "main" and not crosswalks and not street.gaps:
        crosswalks = [float(rng.choice([-38.0, 34.0, 48.0])) + CROSSWALK_M / 2]
    for at in crosswalks:
        for v in street.stripes():
            lines.quad(
                (at - CROSSWALK_M / 2, v, LINE_Z + 0.001),
                (CROSSWALK_M, 0, 0),
                (0, 0.5, 0),
                (0, 0, 1, 1),
                cell=1.5,
            )
    site.put(f"{street.name}_markings", lines, "marking")
