"""The best points of a proposal by 0-1 programming (Cheng et al., Algorithm 2).

Not the encoding of Algorithm 2, which has a loose relaxation: the cells in one line of a plane
exclude each other, so together they need no more than the category of that line.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from pipeline.core.constraints import Constraints
from pipeline.core.coverage.grid import Int32s
from pipeline.core.coverage.problem import Problem
from pipeline.core.variable import Ints


@dataclass
class _Programme:
    """A mixed 0-1 programme; its columns are at least 0.

    whole: whether each column is a whole number.
    upper, value: upper bound and worth of each column.
    rows: coefficients by column, lower and upper limit of each row.
    """

    whole: list[bool] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    value: list[float] = field(default_factory=list)
    rows: list[tuple[dict[int, float], float, float]] = field(default_factory=list)

    def columns(
        self, count: int, *, whole: bool = False, upper: ArrayLike = 1, value: ArrayLike = 0
    ) -> int:
        """Add columns from 0 to `upper` that are worth `value` each; returns the first."""
        first = len(self.whole)
        self.whole += [whole] * count
        self.upper += np.broadcast_to(upper, count).tolist()
        self.value += np.broadcast_to(value, count).tolist()
        return first

    def solve(self, time_limit_s: float) -> tuple[np.ndarray | None, int]:
        """The best solution within the time, and an upper bound of the value."""
        entries = [
            (value, i, column)
            for i, (row, _, _) in enumerate(self.rows)
            for column, value in row.items()
        ]
        values, rows, columns = zip(*entries, strict=True)
        matrix = csr_array((values, (rows, columns)), shape=(len(self.rows), len(self.whole)))
        low, high = [low for _, low, _ in self.rows], [high for _, _, high in self.rows]
        result = milp(
            -np.array(self.value),
            integrality=np.array(self.whole),
            bounds=Bounds(0, np.array(self.upper)),
            constraints=LinearConstraint(matrix, low, high),
            options={"time_limit": time_limit_s},
        )
        best = np.dot(self.value, self.upper)
        if result.mip_dual_bound is not None:
            best = -result.mip_dual_bound
        return (None if result.x is None else np.asarray(result.x)), int(np.floor(best + 1e-6))


def best_points(
    problem: Problem,
    constraints: Constraints,
    wanted: tuple[Ints, Ints],
    count: int,
    time_limit_s: float,
) -> tuple[Int32s | None, int]:
    """Solve for the points that are worth most together.

    Args:
        problem: the cells of all planes.
        constraints: of the problem's columns.
        wanted: (cells,) points that each cell still wants, and (cells,) the worth of each.
        count: number of points, at least 1.
        time_limit_s: seconds, > 0.

    Returns:
        The points, (count, n), or None if the time ran out before a solution; and an upper bound
        of their worth.
    """
    sizes = constraints.sizes
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    programme = _Programme()
    for _ in range(count):
        _add_point(programme, first, constraints)
    missing, worth = wanted
    cells = np.flatnonzero(missing)
    reached: list[dict[int, float]] = [{} for _ in cells]
    for point in range(count):
        # A column for each cell that the point may lie in.
        occupied = programme.columns(len(cells))
        lines: dict[tuple[int, int, int], dict[int, float]] = {}
        for i, cell in enumerate(cells):
            reached[i][occupied + i] = -1.0
            plane = int(np.searchsorted(problem.first, cell, side="right"))
            columns, categories = problem.cell(int(cell))
            for column, category in zip(columns.tolist(), categories.tolist(), strict=True):
                lines.setdefault((plane, column, category), {})[occupied + i] = 1.0
        for (_, column, category), line in lines.items():
            chosen = point * int(first[-1]) + int(first[column]) + category
            programme.rows.append(({**line, chosen: -1.0}, -np.inf, 0))
    gains = programme.columns(len(cells), upper=missing[cells], value=worth[cells])
    for i, row in enumerate(reached):
        programme.rows.append(({**row, gains + i: 1.0}, -np.inf, 0))
    solution, bound = programme.solve(time_limit_s)
    if solution is None:
        return None, bound
    points = solution[: count * int(first[-1])].reshape(count, -1)
    chosen_of = [points[:, first[v] : first[v + 1]].argmax(axis=1) for v in range(len(sizes))]
    return np.stack(chosen_of, axis=1).astype(np.int32), bound


def _add_point(programme: _Programme, first: Ints, constraints: Constraints) -> None:
    """A column for each category of each variable, of which a feasible point has exactly one.

    first: (d + 1,) first column of each variable.
    """
    begin = programme.columns(int(first[-1]), whole=True)
    for variable in range(len(constraints.sizes)):
        alternatives = range(begin + int(first[variable]), begin + int(first[variable + 1]))
        programme.rows.append((dict.fromkeys(alternatives, 1.0), 1, 1))
    for clause in constraints.clauses:
        row: dict[int, float] = {}
        low = 1.0
        for literal in clause:
            column = begin + int(first[literal.variable]) + literal.category
            row[column] = row.get(column, 0.0) + (1.0 if literal.equal else -1.0)
            low -= not literal.equal
        programme.rows.append((row, low, np.inf))
