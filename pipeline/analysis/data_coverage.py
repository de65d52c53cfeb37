"""How far a table of points covers a space, as plain data (Cheng et al., section 3)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import combinations, islice
from typing import Any

import numpy as np

from pipeline.core.constraints import Bools
from pipeline.core.coverage.projection import Counts, Coverage, Demand, Plane, planes
from pipeline.core.coverage.raising import RaisingPoints
from pipeline.core.space import Ints, Space

Answer = dict[str, Any]
"""Plain data, as --json prints it."""
LISTED = 1000
"""Longest list of planes or cells; the totals are always complete."""
NEXT_POINTS = 5
GROWTH_STEPS = 60
NONE: Answer = {"numerator": 0, "denominator": 0, "coverage": None}
"""The fraction of planes that want no points."""


def planes_of(rows: Ints, demand: Demand) -> list[Plane]:
    """Every plane of a demand, with the counts of the rows, (n, d) category indices."""
    counts = demand.counts()
    counts.add(rows)
    return list(planes(counts, demand))


def fraction(coverage: Coverage) -> Answer:
    """Numerator, denominator and ratio."""
    return {
        "numerator": coverage.covered,
        "denominator": coverage.required,
        "coverage": coverage.ratio,
    }


def details(space: Space, every: Sequence[Plane]) -> Answer:
    """Coverage of each plane, the least first, and the uncovered and the infeasible cells."""
    least = sorted(every, key=lambda plane: plane.coverage.ratio if plane.coverage else np.inf)
    described = []
    for plane in least[:LISTED]:
        described.append(
            {
                "conditions": [space.names[v] for v in plane.variables],
                **(NONE if plane.coverage is None else fraction(plane.coverage)),
                "uncovered_cells": int(_wanting(plane).sum()),
                "infeasible_cells": int(_infeasible(plane).sum()),
            }
        )
    return {
        "plane_count": len(every),
        "planes": described,
        "uncovered_cells": sum(int(_wanting(plane).sum()) for plane in every),
        "uncovered": list(islice(_cells(space, every, _wanting), LISTED)),
        "infeasible_cells": sum(int(_infeasible(plane).sum()) for plane in every),
        "infeasible": list(islice(_cells(space, every, _infeasible), LISTED)),
    }


def _wanting(plane: Plane) -> Bools:
    """The cells with fewer points than wanted."""
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
    names = {}
    for variable, category in zip(variables, cell, strict=True):
        names[space.names[variable]] = space.variables[variable].labels[int(category)]
    return names


def of_extras(space: Space, every: Sequence[Plane]) -> Answer:
    """Coverage of each named plane, and the points in each single combination.

    Empty if the space has neither.
    """
    if not space.extras:
        return {}
    by_variables = {plane.variables: plane for plane in every}
    named_planes, single = [], []
    for group in space.extras.planes:
        covered, required, wanted = 0, 0, False
        for variables in combinations(group.variables, group.strength):
            if coverage := by_variables[variables].coverage:
                covered, required = covered + coverage.covered, required + coverage.required
                wanted = True
        named_planes.append(
            {
                "name": group.name,
                "conditions": [space.names[v] for v in group.variables],
                "strength": group.strength,
                **(fraction(Coverage(covered, required)) if wanted else NONE),
            }
        )
    for combination in space.extras.combinations:
        counts = by_variables[combination.variables].counts
        single.append(
            {
                "of": cell_names(space, combination.variables, combination.categories),
                "weight": combination.weight,
                "points": int(counts[combination.categories]),
            }
        )
    return {"named_planes": named_planes, "combinations": single}


def next_points(space: Space, rows: Ints, demand: Demand) -> list[dict[str, str]]:
    """The few points that raise the coverage of the rows most, by the names of their categories.

    Args:
        space: The scenario space.
        rows: Category indices, (n, d).
        demand: Planes and weights to cover.
    """
    from pipeline.core.coverage.proposals import Proposer  # Takes a second to import.

    proposal = Proposer(demand).propose(rows, NEXT_POINTS)
    return [] if proposal is None else space.names_of(proposal.categories)


def growth(raising: RaisingPoints, coverage: Coverage) -> list[tuple[int, float]]:
    """Coverage after each number of points. coverage: after all of them."""
    points = raising.counts.points
    ends = np.unique(np.linspace(1, points, min(points, GROWTH_STEPS)).astype(int))
    covered = raising.covered_after(ends).tolist()
    shares = (cells / coverage.required for cells in covered)
    return list(zip(map(int, ends), shares, strict=True))


def counted(
    batches: Iterable[Ints], demands: Sequence[Demand], progress: Callable[[int], None]
) -> tuple[list[Counts], RaisingPoints]:
    """Count the points of a table for several demands in one pass.

    Args:
        batches: Category indices, (n, d) each.
        demands: Planes and weights to cover.
        progress: Called with the number of points so far.

    Returns:
        The counts for each demand, and the points that raise the coverage of the last one.
    """
    counts, raising = [demand.counts() for demand in demands[:-1]], RaisingPoints(demands[-1])
    for rows in batches:
        for cells in counts:
            cells.add(rows)
        raising.add(rows)
        progress(raising.counts.points)
    return [*counts, raising.counts], raising
