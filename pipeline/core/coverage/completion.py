"""The fewest points that complete k-projection coverage, with a proof (Cheng et al., Definition 5).

Integer programming over the feasible points: how often to take each so that every cell gets what
it still wants. Points that help the same cells are of one kind, and conditions without such a cell
do not matter. All limits are counts, so no answer depends on time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from pipeline.core.constraints import Constraints, satisfied
from pipeline.core.coverage.problem import Problem
from pipeline.core.variable import Ints

MOST_POINTS = 50_000
"""Feasible points that are listed, at most."""
MOST_KINDS = 1_500
"""Kinds of points in a programme, at most."""
PART_KINDS = 300
"""The same for a bound from part of the conditions."""
WORK = 120_000
"""Kinds times nodes of branch and bound, at most: a larger programme ends with a bound."""
INFEASIBLE_STATUS, TOLERANCE = 2, 1e-6
"""Of scipy's `milp`: the status, and how far a bound may lie above a whole number."""


@dataclass(frozen=True)
class Completion:
    """Points that complete the coverage.

    Attributes:
        categories: (m, d) category indices.
        bound: no fewer points complete the coverage; in [0, m].
    """

    categories: Ints
    bound: int

    @property
    def smallest(self) -> bool:
        """Whether it is proved that no completion has fewer points."""
        return len(self.categories) == self.bound

    def better(self, other: Completion) -> Completion:
        """The fewer points of two completions of the same points, with the higher bound."""
        fewer = min(self.categories, other.categories, key=len)
        return Completion(fewer, max(self.bound, other.bound))


@dataclass(frozen=True)
class Task:
    """What a completion must meet.

    constraints, problem: of the same columns.
    missing: (cells,) points that each cell of the problem still wants.
    """

    constraints: Constraints
    problem: Problem
    missing: Ints

    @property
    def of_plane(self) -> Ints:
        """Missing points of each plane, (planes,)."""
        return np.asarray(np.add.reduceat(self.missing, self.problem.first), np.int64)


@dataclass(frozen=True)
class Programme:
    """An integer programme of feasible points.

    constraints: of all n columns.
    columns: the conditions that matter.
    kinds: (m, columns) a point of each kind.
    helps: (cells, m) which cells each kind of point fills.
    wanted: (cells,) points.
    """

    constraints: Constraints
    columns: list[int]
    kinds: Ints
    helps: csr_array
    wanted: Ints

    def solve(self, low: int, high: float = np.inf) -> tuple[Ints | None, int]:
        """Solve for the fewest points.

        Args:
            low: a lower bound that is already proved.
            high: most points of interest, such as one less than are known to suffice.

        Returns:
            The points, (m, n), or None if no solution with `low` to `high` points was reached; and
            a lower bound of the points that are needed.
        """
        if low > high:
            return None, low
        count = len(self.kinds)
        result = milp(
            np.ones(count),
            integrality=np.ones(count),
            bounds=Bounds(0, self.wanted.max()),
            constraints=[
                LinearConstraint(self.helps, self.wanted, np.inf),
                LinearConstraint(np.ones((1, count)), low, high),
            ],
            options={"node_limit": max(1, WORK // count), "mip_rel_gap": 0.0},
        )
        if result.status == INFEASIBLE_STATUS:
            return None, int(high) + 1
        bound = low
        if result.mip_dual_bound is not None:
            bound = max(low, int(np.ceil(result.mip_dual_bound - TOLERANCE)))
        if result.x is None:
            return None, bound
        numbers = np.rint(result.x).astype(np.int64)
        assert (self.helps @ numbers >= self.wanted).all(), "a solution covers every cell"
        rows = []
        for kind in np.repeat(self.kinds, numbers, axis=0).tolist():
            rows.append(self.constraints.complete(dict(zip(self.columns, kind, strict=True))))
        return np.array(rows, np.int64), bound


def whole_programme(task: Task) -> Programme | None:
    """The programme whose solution completes the coverage.

    None if nothing is missing, or if there are too many points to list.
    """
    if not task.missing.any():
        return None
    columns: list[int] = np.unique(task.problem.grid.planes[task.of_plane > 0]).tolist()
    return _programme(task, columns, MOST_KINDS)


def bound_of_part(task: Task, low: int, high: int) -> int:
    """A lower bound of the points that complete the coverage: what some of the conditions need.

    Args:
        task: what is missing.
        low: a lower bound that is already proved.
        high: points that are known to suffice.

    Returns:
        The bound, in [low, high].
    """
    part = _programme(task, _part(task), PART_KINDS) if low < high else None
    return low if part is None else part.solve(low, high - 1)[1]


def _programme(task: Task, columns: list[int], most: int) -> Programme | None:
    """The programme of all planes within the columns; None if there are too many kinds."""
    points = _feasible_points(columns, task.constraints)
    if points is None:
        return None
    grid, place = task.problem.grid, np.zeros(len(task.problem.sizes), np.int64)
    place[columns] = np.arange(len(columns))
    inside = np.flatnonzero(np.isin(grid.planes, columns).all(axis=1))
    cells_of = [
        grid.first[plane] + points[:, place[grid.planes[plane]]] @ grid.stride[plane]
        for plane in inside
    ]
    cells = np.stack(cells_of, axis=1)
    helped = np.where(task.missing[cells] > 0, cells, -1)
    cells, first = np.unique(helped, axis=0, return_index=True)
    if len(first) > most:
        return None
    kind, at = np.nonzero(cells >= 0)
    wanting, row = np.unique(cells[kind, at], return_inverse=True)
    helps = csr_array((np.ones(len(row)), (row, kind)), shape=(len(wanting), len(first)))
    return Programme(task.constraints, columns, points[first], helps, task.missing[wanting])


def _feasible_points(columns: list[int], constraints: Constraints) -> Ints | None:
    """Combinations of the columns' categories that a feasible point has; None if too many."""
    points = np.zeros((1, len(constraints.sizes)), np.int64)
    for number, column in enumerate(columns):
        size, listed = constraints.sizes[column], set(columns[: number + 1])
        if len(points) * size > MOST_POINTS:
            return None
        points = np.repeat(points, size, axis=0)
        points[:, column] = np.tile(np.arange(size), len(points) // size)
        for clause in constraints.clauses:
            named = {literal.variable for literal in clause}
            if column in named and named <= listed:
                points = points[satisfied(clause, points)]
    points = points[:, columns]
    if constraints.named <= set(columns):
        return points
    possible = []
    for row in points.tolist():
        possible.append(constraints.satisfiable(dict(zip(columns, row, strict=True))))
    return points[np.array(possible, np.bool_)]


def _part(task: Task) -> list[int]:
    """Some of the columns with few points and much missing.

    They are those of the emptiest plane, then the next best that fits.
    """
    planes, sizes, missing = task.problem.grid.planes, task.problem.sizes, task.of_plane
    part = planes[int(missing.argmax())].tolist()
    while True:
        outside = ~np.isin(planes, part)
        joins = outside.sum(axis=1) == 1  # Planes that one more column brings in.
        gained = np.zeros(len(sizes), np.int64)
        np.add.at(gained, planes[joins][outside[joins]], missing[joins])
        gained[sizes > PART_KINDS // int(np.prod(sizes[part]))] = 0
        if not gained.any():
            return sorted(part)
        part.append(int(gained.argmax()))
