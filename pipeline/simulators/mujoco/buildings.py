"""Rows of houses along a street."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.scenarios.streets import CORNER_RADIUS, PAVEMENT_WIDTH, Street, Town
from pipeline.simulators.mujoco.mesh import Mesh, Site
from pipeline.simulators.mujoco.style import STYLES, Style

HOUSE_DEPTH = 10.0


@dataclass(frozen=True)
class _House:
    """A house.

    us, vs: its extent along and across the street, metres. wall, roof: indices of the style's.
    floors: above the ground floor.
    """

    us: tuple[float, float]
    vs: tuple[float, float]
    wall: int
    floors: int
    roof: int


def _front(town: Town, style: Style, street: Street, side: int) -> float:
    """Distance of the house fronts from the axis."""
    return street.edge(side) + PAVEMENT_WIDTH + style.setback + (2.5 if town.overgrown(side) else 0)


def add(site: Site, town: Town, street: Street, side: int, rng: np.random.Generator) -> None:
    """House fronts, gable ends and roofs, one mesh a surface.

    A cross row closes the street at its end.
    """
    style = STYLES[town.style]
    parts: dict[str, Mesh] = {}
    panes = Mesh()
    front = _front(town, style, street, side)
    # The main street's corner houses also front the side street, whose houses begin behind them.
    u = (
        street.start - 10
        if street.name == "main"
        else PAVEMENT_WIDTH + style.setback + HOUSE_DEPTH + 4
    )
    clear = PAVEMENT_WIDTH + style.setback - CORNER_RADIUS + 0.5
    gaps = sorted((gap for gap in street.gaps if gap.side == side), key=lambda gap: gap.start)
    while u < street.end:
        width = rng.uniform(*style.widths)
        wall, floors = (
            int(rng.integers(len(style.walls))),
            int(rng.integers(style.storeys[0], style.storeys[1] + 1)),
        )
        for gap in gaps:
            if gap.start - clear < u + width and u < gap.end + clear:
                if u + 8 > gap.start - clear:
                    u = gap.end + clear
                else:
                    width = gap.start - clear - u
        v = front + rng.uniform(0, 1.2)
        _build(
            parts,
            _House(
                (u, u + width),
                (side * v, side * (v + HOUSE_DEPTH)),
                wall,
                floors,
                int(rng.integers(len(style.roofs))),
            ),
        )
        for _ in range(floors):
            window = u + 0.9 + 3 * rng.integers(max(1, int(width / 3)))
            height = 3.5 + 3 * rng.integers(floors) + 0.75
            edge = (1.2, 0, 0) if side > 0 else (-1.2, 0, 0)
            panes.quad(
                (window + (0 if side > 0 else 1.2), side * (v - 0.02), height),
                edge,
                (0, 0, 1.5),
                (0, 0, 1, 1),
            )
        u += width + style.gap + (rng.uniform(3, 8) if rng.random() < 0.2 else 0)
    if side > 0:
        behind = street.end + (22 if street.name == "main" else 8)
        for k, v in enumerate((-26.0, -9.0, 8.0)):
            _build(
                parts,
                _House(
                    (behind, behind + 12),
                    (v, v + 16.5),
                    k % len(style.walls),
                    style.storeys[1],
                    k % len(style.roofs),
                ),
            )
    for name, mesh in [*parts.items(), ("window_light", panes)]:
        site.put(f"{street.name}_{name}_{side}", mesh, name)


def _build(parts: dict[str, Mesh], house: _House) -> None:
    (x0, x1), y0, y1 = house.us, min(house.vs), max(house.vs)
    wall, floors = house.wall, house.floors
    eaves = 3.5 + 3.0 * floors
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        edge, length = (bx - ax, by - ay, 0.0), float(np.hypot(bx - ax, by - ay))
        bays = max(1, round(length / 3)) / 2
        parts.setdefault(f"ground{wall}", Mesh()).quad(
            (ax, ay, 0), edge, (0, 0, 3.5), (0, 1, bays * 6 / 14, 0)
        )
        parts.setdefault(f"wall{wall}", Mesh()).quad(
            (ax, ay, 3.5), edge, (0, 0, 3.0 * floors), (0, floors / 2, bays, 0)
        )
    surface = parts.setdefault(f"roof{house.roof}", Mesh())
    middle, ridge = (y0 + y1) / 2, eaves + 0.32 * (y1 - y0)
    span, slope = x1 - x0 + 0.8, np.hypot(middle - y0, ridge - eaves)
    surface.quad(
        (x0 - 0.4, y0 - 0.4, eaves - 0.2),
        (span, 0, 0),
        (0, middle - y0 + 0.4, ridge - eaves + 0.2),
        (0, 0, span / 4, slope / 4),
    )
    surface.quad(
        (x1 + 0.4, y1 + 0.4, eaves - 0.2),
        (-span, 0, 0),
        (0, middle - y1 - 0.4, ridge - eaves + 0.2),
        (0, 0, span / 4, slope / 4),
    )
    gable = parts[f"ground{wall}"]
    gable.triangle(
        [(x0, y1, eaves), (x0, y0, eaves), (x0, middle, ridge)],
        [(0.02, 0.1), (0.06, 0.1), (0.04, 0.02)],
    )
    gable.triangle(
        [(x1, y0, eaves), (x1, y1, eaves), (x1, middle, ridge)],
        [(0.02, 0.1), (0.06, 0.1), (0.04, 0.02)],
    )
