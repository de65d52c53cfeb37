"""What a covering array must cover, laid out once for the kernels of the search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.constraints import Bools, Constraints
from pipeline.core.coverage import annealing
from pipeline.core.coverage.annealing import Cooling
from pipeline.core.coverage.grid import Clauses, Grid, Int32s, Lines
from pipeline.core.coverage.mixed import Mixed, Planes, all_planes, filled_up
from pipeline.core.space import Ints

INFEASIBLE = np.int32(1 << 30)
"""Count of a cell that is infeasible or not wanted, so that it is never uncovered."""


@dataclass(frozen=True)
class Problem:
    """What must be covered.

    If planes have different sizes, the last column has one category. It fills up the smaller
    planes, and the last plane is its own, which is never required.

    Attributes:
        grid: the cells of all planes.
        required: (cells,) whether some row reaches the cell and it is wanted.
    """

    grid: Grid
    required: Bools

    @property
    def sizes(self) -> Int32s:
        """(n,) categories of each column."""
        return self.grid.sizes

    @property
    def strength(self) -> int:
        """t, the columns of the largest plane."""
        return int(self.grid.planes.shape[1])

    @property
    def first(self) -> Ints:
        """(planes,) first cell of each plane."""
        return self.grid.first

    @property
    def literals_a_column(self) -> float:
        """Mean number of literals to check when a category changes."""
        clauses = self.grid.clauses
        return float(np.diff(clauses.literal_start)[clauses.of].sum()) / len(self.sizes)

    def counts(self, rows: Int32s) -> Int32s:
        """Number of rows in each cell, (cells,); `INFEASIBLE` if it is not required."""
        counts = np.where(self.required, np.int32(0), INFEASIBLE)
        self.count(rows, counts)
        return counts

    def count(self, rows: Int32s, counts: Int32s) -> None:
        """Add the cells of (m, n) rows to (cells,) counts."""
        annealing.add_rows(self.grid, rows, counts)

    def unique_cells(self, rows: Int32s) -> Ints:
        """Number of cells that each row alone covers, (rows,)."""
        return np.asarray(annealing.unique_cells(self.grid, rows, self.counts(rows)), np.int64)

    def best_row(
        self, starts: Int32s, worth: Int32s | Ints, held: Bools, sweeps: int, seed: int
    ) -> Int32s:
        """The most valuable row that coordinate ascent reaches from the starts, (n,).

        Ties are broken at random, so that the search walks across plateaus.

        Args:
            starts: (m, n) feasible rows.
            worth: (cells,) worth of a row in each cell; a row's worth is the sum over its cells.
            held: (n,) columns that keep the start's category.
            sweeps: most passes over all columns.
            seed: seed of the kernels' random draws.
        """
        annealing.seed_kernels(seed)
        return np.asarray(annealing.best_row(self.grid, starts, worth, held, sweeps), np.int32)

    def anneal(
        self,
        rows: Int32s,
        counts: Int32s,
        iterations: int,
        temperatures: tuple[float, float],
        seed: int,
    ) -> int:
        """Change single categories of `rows`, in place, until every cell is covered.

        A move takes an uncovered cell and the row nearest to it, and gives the row one of the
        cell's categories. Rows stay feasible.

        Args:
            rows: (m, n), changed in place.
            counts: (cells,) counts of `rows` and of other, fixed rows; updated.
            iterations: most moves to try.
            temperatures: first and last, in cells.
            seed: seed of the kernels' random draws.

        Returns:
            The number of cells left uncovered.
        """
        annealing.seed_kernels(seed)
        return int(annealing.anneal(self.grid, rows, counts, Cooling(iterations, *temperatures)))

    def cell(self, number: int) -> tuple[Int32s, Int32s]:
        """Columns and categories of a cell."""
        plane = int(np.searchsorted(self.first, number, side="right")) - 1
        rest, categories = number - int(self.first[plane]), np.empty(self.strength, np.int32)
        for position in range(self.strength):
            categories[position], rest = divmod(rest, int(self.grid.stride[plane, position]))
        return self.grid.planes[plane], categories


def of_strength(constraints: Constraints, strength: int) -> Problem:
    """The problem in which every feasible cell of any `strength` columns is wanted."""
    return lay_out(constraints, all_planes(len(constraints.sizes), Mixed(strength)))


def lay_out(constraints: Constraints, planes: Planes) -> Problem:
    """Lay a problem out for the kernels.

    Args:
        constraints: as `copy_for` returns them for the planes.
        planes: as `all_planes` lists them.
    """
    n, idle = len(constraints.sizes), len(constraints.sizes) - 1
    size = np.array(constraints.sizes, np.int32)
    columns = filled_up(planes, idle)
    if mixed := len(set(map(len, planes))) > 1:
        columns.append((idle,) * len(columns[0]))
    listed = np.array(columns, np.int32)
    shape = size[listed]
    stride = np.ones_like(shape)
    for position in range(shape.shape[1] - 2, -1, -1):
        stride[:, position] = stride[:, position + 1] * shape[:, position + 1]
    first = np.concatenate([[0], np.cumsum(np.prod(shape, axis=1, dtype=np.int64))])
    required = np.ones(int(first[-1]), bool)
    for index, (plane, wanted) in enumerate(planes.items()):
        cells = required[first[index] : first[index + 1]]
        if not constraints.named.isdisjoint(plane):
            cells[:] = constraints.feasible_cells(plane).ravel()
        if wanted is not None:
            numbers = [np.dot(cell, stride[index, : len(plane)]) for cell in wanted]
            cells &= np.isin(np.arange(len(cells)), numbers)
    required[first[-2] :] &= not mixed
    lines = _lines(listed, first, stride, (n, idle if mixed else n))
    grid = Grid(size, listed, first[:-1], stride, lines, _clauses(n, constraints))
    return Problem(grid, required)


def _lines(planes: Int32s, first: Ints, stride: Int32s, columns: tuple[int, int]) -> Lines:
    """The lines of every column; columns: number of columns, and of those that can change.

    A column with fewer planes than others also has lines of one cell, that of the last plane.
    """
    strength, last, (count, changing) = planes.shape[1], len(planes) - 1, columns
    of_column = [np.argwhere(planes == column) for column in range(changing)]
    shape = (count, max(map(len, of_column)))
    base, step = np.full(shape, first[last], np.int32), np.zeros(shape, np.int32)
    other = np.full((*shape, strength - 1), planes[last, 0], np.int32)
    other_step = np.zeros((*shape, strength - 1), np.int32)
    for column, places in enumerate(of_column):
        for q, (plane, position) in enumerate(places):
            base[column, q], step[column, q] = first[plane], stride[plane, position]
            other[column, q] = np.delete(planes[plane], position)
            other_step[column, q] = np.delete(stride[plane], position)
    return Lines(base, step, other, other_step)


def feasible_rows(
    problem: Problem, constraints: Constraints, cells: Ints, rng: np.random.Generator
) -> Int32s:
    """A random feasible row in each of some feasible cells, (cells, n)."""
    rows = np.empty((len(cells), len(constraints.sizes)), np.int32)
    for row, number in zip(rows, cells.tolist(), strict=True):
        columns, categories = problem.cell(number)
        if constraints.clauses:
            fixed = dict(zip(columns.tolist(), categories.tolist(), strict=True))
            completed = constraints.complete(fixed, rng)
            assert completed is not None, "a feasible cell has a feasible row"
            row[:] = completed
        else:
            row[:] = rng.integers(0, constraints.sizes)
            row[columns] = categories
    return rows


def _clauses(columns: int, constraints: Constraints) -> Clauses:
    by_column: list[list[int]] = [[] for _ in range(columns)]
    for index, clause in enumerate(constraints.clauses):
        for column in {literal.variable for literal in clause}:
            by_column[column].append(index)
    literals = [literal for clause in constraints.clauses for literal in clause]
    return Clauses(
        np.cumsum([0, *map(len, by_column)]).astype(np.int32),
        np.array([index for indices in by_column for index in indices], np.int32),
        np.cumsum([0, *map(len, constraints.clauses)]).astype(np.int32),
        np.array([literal.variable for literal in literals], np.int32),
        np.array([literal.category for literal in literals], np.int32),
        np.array([literal.equal for literal in literals], np.bool_),
    )
