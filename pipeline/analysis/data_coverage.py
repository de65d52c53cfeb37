"""How far a table of points covers a space, plane by plane and cell by cell, as plain data (Cheng et al., section 3)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import combinations, islice
from typing import Any

import numpy as np

from pipeline.core.constraints import Bools
from pipeline.core.coverage.projection import Counts, Coverage, Demand, Plane, planes
from pipeline.core.coverage.raising import RaisingPoints
from pipeline.core.space import Ints, Space

Found = dict[str, Any]
LISTED = 1000
"""Longest list of planes or cells; the totals are always complete."""
NEXT_POINTS = 5
GROWTH_STEPS = 60
NONE: Found = {"numerator": 0, "denominator": 0, "coverage": None}
"""The fraction of planes that want no points."""


def planes_of(rows: Ints, demand: Demand) -> list[Plane]:
    """Every plane with the counts of (n, d) category indices."""
    counts = demand.counts()
    counts.add(rows)
    return list(planes(counts, demand))


def fraction(coverage: Coverage) -> Found:
    """Numerator, denominator and ratio."""
    return {
        "numerator": coverage.covered,
        "denominator": coverage.required,
        "coverage": coverage.ratio,
    }


def details(space: Space, every: Sequence[Plane]) -> Found:
    """Coverage of each plane, the least first, and the cells that still want points or that no feasible point reaches."""
    least = sorted(every, key=lambda plane: plane.coverage.ratio if plane.coverage else np.inf)
    return {
        "plane_count": len(every),
        "planes": [_plane(space, plane) for plane in least[:LISTED]],
        "uncovered_cells": sum(int(_wanting(plane).sum()) for plane in every),
        "uncovered": list(islice(_cells(space, every, _wanting), LISTED)),
        "infeasible_cells": sum(int(_infeasible(plane).sum()) for plane in every),
        "infeasible": list(islice(_cells(space, every, _infeasible), LISTED)),
    }


def of_extras(space: Space, every: Sequence[Plane]) -> Found:
    """Coverage of each named plane, and the points in each single combination; nothing if the space has neither."""
    by_variables = {plane.variables: plane for plane in every}
    named, single = [], []
    for group in space.extras.planes:
        own = [
            by_variables[chosen].coverage
            for chosen in combinations(group.variables, group.strength)
        ]
        whole = Coverage(
            sum(one.covered for one in own if one), sum(one.required for one in own if one)
        )
        conditions = [space.names[v] for v in group.variables]
        named.append(
            {
                "name": group.name,
                "conditions": conditions,
                "strength": group.strength,
                **(fraction(whole) if any(own) else NONE),
            }
        )
    for one in space.extras.combinations:
        points = int(by_variables[one.variables].counts[one.categories])
        single.append(
            {
                "of": cell_names(space, one.variables, one.categories),
                "weight": one.weight,
                "points": points,
            }
        )
    return {"named_planes": named, "combinations": single} if space.extras else {}


def next_points(space: Space, rows: Ints, demand: Demand) -> list[dict[str, str]]:
    """The few points that raise the coverage of (n, d) category indices most, with the names of their categories."""
    from pipeline.core.coverage.proposals import Proposer  # Takes a second to import.

    found = Proposer(demand).propose(rows, NEXT_POINTS)
    return [] if found is None else space.names_of(found.categories)


def growth(raising: RaisingPoints, coverage: Coverage) -> list[tuple[int, float]]:
    """Coverage after each number of points; coverage: after all."""
    points = raising.counts.points
    ends = np.unique(np.linspace(1, points, min(points, GROWTH_STEPS)).astype(int))
    return [
        (int(end), covered / coverage.required)
        for end, covered in zip(ends, raising.covered_after(ends).tolist(), strict=True)
    ]


def counted(
    batches: Iterable[Ints], demands: Sequence[Demand], progress: Callable[[int], None]
) -> tuple[list[Counts], RaisingPoints]:
    """Counts of (n, d) category indices for each demand, and the points that raise the coverage of the last one.

    progress: is called with the number of points so far.
    """
    counts, raising = [demand.counts() for demand in demands[:-1]], RaisingPoints(demands[-1])
    for rows in batches:
        for cells in counts:
            cells.add(rows)
        raising.add(rows)
        progress(raising.counts.points)
    return [*counts, raising.counts], raising


def _wanting(plane: Plane) -> Bools:
    return np.asarray(plane.counts < plane.wanted)


def _infeasible(plane: Plane) -> Bools:
    return ~plane.feasible


def _cells(
    space: Space, every: Iterable[Plane], which: Callable[[Plane], Bools]
) -> Iterator[dict[str, str]]:
    """The cells of all planes that `which` marks, with the names of their categories."""
    for plane in every:
        marked = which(plane)
        for cell in np.argwhere(marked) if marked.any() else ():
            yield cell_names(space, plane.variables, cell)


def cell_names(space: Space, variables: Iterable[int], cell: Iterable[int]) -> dict[str, str]:
    """A cell with the names of its variables and categories."""
    return {
        space.names[v]: space.variables[v].labels[int(c)]
        for v, c in zip(variables, cell, strict=True)
    }


def _plane(space: Space, plane: Plane) -> Found:
    own = plane.coverage
    return {
        "conditions": [space.names[v] for v in plane.variables],
        **(NONE if own is None else fraction(own)),
        "uncovered_cells": int(_wanting(plane).sum()),
        "infeasible_cells": int(_infeasible(plane).sum()),
    }
