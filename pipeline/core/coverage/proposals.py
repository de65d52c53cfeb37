"""Proposals: the feasible point that raises k-projection coverage most (Cheng et al., Definition 5, Algorithms 1 and 2)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from pipeline.core.constraints import Clause, Constraints
from pipeline.core.coverage.projection import cell_counts
from pipeline.core.space import Ints

OPTIMAL = 0
"""Status of scipy.optimize.milp."""


@dataclass(frozen=True)
class Proposal:
    """categories: (d,) category indices of the point. gain: cells that it covers for the first time, at least 1."""

    categories: Ints
    gain: int


def propose(categories: Ints, constraints: Constraints, k: int) -> Proposal | None:
    """The point that covers most cells that no point covers yet, None where every feasible cell is covered.

    categories: (n, d) category indices of the points so far, n may be 0. k: 1 to d. The optimum, by 0-1 programming with HiGHS.

    Not the encoding of Algorithm 2, whose relaxation is loose: the cells of a plane in one line of it exclude each other, so together
    they need no more than the category of that line.
    """
    sizes = constraints.sizes
    first = np.concatenate([[0], np.cumsum(sizes)])
    programme = _Programme(int(first[-1]))
    for variable, size in enumerate(sizes):
        programme.add({int(first[variable]) + category: 1.0 for category in range(size)}, 1, 1)
    for clause in constraints.clauses:
        programme.add(*_at_least_one(clause, first))
    for chosen in combinations(range(len(sizes)), k):
        _add_plane(programme, chosen, _uncovered(categories, constraints, chosen), first)
    if programme.columns == first[-1]:
        return None
    solution = programme.solve(int(first[-1]))
    point = np.array([np.argmax(solution[first[v] : first[v + 1]]) for v in range(len(sizes))], dtype=np.int64)
    return Proposal(point, round(float(solution[first[-1] :].sum())))


def complete(categories: Ints, constraints: Constraints, k: int) -> Iterator[Proposal]:
    """Proposals, each given those before it, until every feasible cell is covered (Algorithm 1)."""
    while (proposal := propose(categories, constraints, k)) is not None:
        yield proposal
        categories = np.vstack([categories, proposal.categories])


def _uncovered(categories: Ints, constraints: Constraints, chosen: Sequence[int]) -> Ints:
    """(m, k) the feasible cells of a plane that no point lies in."""
    feasible = constraints.feasible_cells(chosen)
    empty = cell_counts(categories, constraints.sizes, chosen).reshape(feasible.shape) == 0
    return np.argwhere(feasible & empty)


def _add_plane(programme: _Programme, chosen: Sequence[int], cells: Ints, first: Ints) -> None:
    """A column for each cell, and for each line of the plane: its cells together at most the category that they share."""
    columns = [programme.column() for _ in cells]
    for axis, variable in enumerate(chosen):
        for category in np.unique(cells[:, axis]):
            line = {column: 1.0 for column, cell in zip(columns, cells, strict=True) if cell[axis] == category}
            programme.add({**line, int(first[variable] + category): -1.0}, -np.inf, 0)


def _at_least_one(clause: Clause, first: Ints) -> tuple[dict[int, float], float, float]:
    """A clause as a row: the sum of its literals, where `!=` counts one less what is chosen, is at least 1."""
    row: dict[int, float] = {}
    bound = 1.0
    for literal in clause:
        column = int(first[literal.variable] + literal.category)
        row[column] = row.get(column, 0.0) + (1.0 if literal.equal else -1.0)
        bound -= not literal.equal
    return row, bound, np.inf


class _Programme:
    """Rows and columns of a 0-1 programme that maximises the sum of all columns but the first ones, which are whole."""

    def __init__(self, columns: int) -> None:
        self.columns = columns
        self._rows: list[tuple[dict[int, float], float, float]] = []

    def column(self) -> int:
        self.columns += 1
        return self.columns - 1

    def add(self, row: dict[int, float], low: float, high: float) -> None:
        self._rows.append((row, low, high))

    def solve(self, whole: int) -> np.ndarray:
        """(columns,) the optimum; the first `whole` columns are 0 or 1."""
        entries = [(value, i, column) for i, (row, _, _) in enumerate(self._rows) for column, value in row.items()]
        values, rows, columns = zip(*entries, strict=True)
        matrix = csr_array((values, (rows, columns)), shape=(len(self._rows), self.columns))
        limits = LinearConstraint(matrix, [low for _, low, _ in self._rows], [high for _, _, high in self._rows])
        is_whole = np.arange(self.columns) < whole
        result = milp(-1.0 * ~is_whole, integrality=is_whole, bounds=Bounds(0, 1), constraints=limits)
        if result.status != OPTIMAL:
            raise RuntimeError(f"HiGHS: {result.message}")
        return np.asarray(result.x)
