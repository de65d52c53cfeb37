"""The kernels of covering arrays: greedy rows by coordinate ascent, and simulated annealing of the cells that are left uncovered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.constraints import Bools, Constraints
from pipeline.core.space import Ints

Int32s = NDArray[np.int32]
Layout = tuple[Int32s, Int32s, Int32s, Int32s]
Clauses = tuple[Int32s, Int32s, Int32s, Int32s, Int32s, Bools]
Planes = tuple[Int32s, Ints, Int32s]
SHAKEN = 0.2
"""How often a random row is changed where none is but one category away from a cell."""
INFEASIBLE = np.int32(1 << 30)
"""Count of a cell that no feasible point reaches: never uncovered."""


@dataclass(frozen=True)
class Problem:
    """What must be covered, laid out for the kernels.

    sizes: (n,). cells: number of cells of all planes; `feasible`: (cells,). first, stride: (planes,) first cell of each plane and
    (planes, t) the step of each of its columns. For column c and the q-th plane that it is in: base[c, q] is that plane's first cell,
    step[c, q] the column's own stride, other[c, q] and other_step[c, q] the plane's other columns and their strides.
    clause_of, clause_start: clauses in which each column stands; literal_*: their literals, from literal_start[clause] on.
    """

    strength: int
    sizes: Int32s
    planes: Int32s
    first: Ints
    stride: Int32s
    feasible: Bools
    base: Int32s
    step: Int32s
    other: Int32s
    other_step: Int32s
    clause_start: Int32s
    clause_of: Int32s
    literal_start: Int32s
    literal_column: Int32s
    literal_category: Int32s
    literal_equal: Bools

    @property
    def _clauses(self) -> Clauses:
        return self.clause_start, self.clause_of, self.literal_start, self.literal_column, self.literal_category, self.literal_equal

    @property
    def _layout(self) -> Layout:
        return self.base, self.step, self.other, self.other_step

    @property
    def literals_a_column(self) -> float:
        """How many literals must be looked at, on average, to change a category."""
        return float(np.diff(self.literal_start)[self.clause_of].sum()) / len(self.sizes) if len(self.clause_of) else 0.0

    def counts(self, rows: Int32s) -> Int32s:
        """(cells,) how many rows lie in each cell; `INFEASIBLE` where none can."""
        counts = np.where(self.feasible, np.int32(0), INFEASIBLE)
        self.count(rows, counts)
        return counts

    def count(self, rows: Int32s, counts: Int32s) -> None:
        """Add the cells of (m, n) rows to (cells,) counts."""
        _add_rows(rows, self.planes, self.first, self.stride, counts)

    def unique_cells(self, rows: Int32s) -> Ints:
        """(rows,) how many cells each row alone covers."""
        return np.asarray(_unique_cells(rows, self.planes, self.first, self.stride, self.counts(rows)), np.int64)

    def best_row(self, starts: Int32s, worth: Int32s, held: Bools, sweeps: int, seed: int) -> Int32s:
        """The row of most worth among those that coordinate ascent reaches from each start; (n,).

        starts: (m, n) feasible rows. worth: (cells,) of a row in each cell; the row's is the sum over its cells. held: (n,) columns that
        keep the start's category. Ties go to a random category, so that a plateau is walked, not stood on.
        """
        return np.asarray(_best_row(starts, self.sizes, worth, self._layout, self._clauses, held, sweeps, seed), np.int32)

    def anneal(
        self, rows: Int32s, counts: Int32s, iterations: int, temperatures: tuple[float, float], seed: int, first_free: int = 0
    ) -> int:
        """Change single categories of `rows`, in place, until no cell is uncovered; returns how many still are.

        A move takes an uncovered cell and the row, of those from `first_free` on, that comes nearest to it, and gives the row one of the
        categories that it lacks. The rows stay feasible. counts: of `rows`; kept. temperatures: first and last, in cells.
        """
        planes = (self.planes, self.first, self.stride)
        return int(_anneal(rows, first_free, counts, planes, self._layout, self._clauses, self.sizes, iterations, *temperatures, seed))

    def cell(self, number: int) -> tuple[Int32s, Int32s]:
        """Columns and categories of a cell."""
        plane = int(np.searchsorted(self.first, number, side="right")) - 1
        rest, categories = number - int(self.first[plane]), np.empty(self.strength, np.int32)
        for position in range(self.strength):
            categories[position], rest = divmod(rest, int(self.stride[plane, position]))
        return self.planes[plane], categories


def lay_out(sizes: Sequence[int], strength: int, constraints: Constraints) -> Problem:
    """Lay a problem out for the kernels."""
    n = len(sizes)
    size = np.array(sizes, np.int32)
    planes = np.array(list(combinations(range(n), strength)), np.int32).reshape(-1, strength)
    shape = size[planes]
    stride = np.ones_like(shape)
    for position in range(strength - 2, -1, -1):
        stride[:, position] = stride[:, position + 1] * shape[:, position + 1]
    first = np.concatenate([[0], np.cumsum(np.prod(shape, axis=1, dtype=np.int64))])
    feasible = np.ones(int(first[-1]), bool)
    if constraints.clauses:
        for index, plane in enumerate(planes.tolist()):
            if not constraints.named.isdisjoint(plane):
                feasible[first[index] : first[index + 1]] = constraints.feasible_cells(plane).ravel()
    of_column = [np.argwhere(planes == column) for column in range(n)]
    others = [[position for position in range(strength) if position != own] for own in range(strength)]
    base = np.array([first[found[:, 0]] for found in of_column], np.int32)
    step = np.array([stride[found[:, 0], found[:, 1]] for found in of_column], np.int32)
    other = np.array([[planes[plane, others[own]] for plane, own in found] for found in of_column], np.int32)
    other_step = np.array([[stride[plane, others[own]] for plane, own in found] for found in of_column], np.int32)
    return Problem(strength, size, planes, first[:-1], stride, feasible, base, step, other, other_step, *_clauses(n, constraints))


def feasible_row(constraints: Constraints, columns: Int32s, categories: Int32s, rng: np.random.Generator) -> Int32s:
    """A random feasible row with these categories in these columns, which some feasible row has."""
    if not constraints.clauses:
        row: Int32s = rng.integers(0, constraints.sizes).astype(np.int32)
        row[columns] = categories
        return row
    completed = constraints.complete(dict(zip(columns.tolist(), categories.tolist(), strict=True)), rng)
    assert completed is not None, "a feasible cell has a feasible row"
    return np.array(completed, np.int32)


def _clauses(columns: int, constraints: Constraints) -> tuple[Int32s, Int32s, Int32s, Int32s, Int32s, Bools]:
    by_column: list[list[int]] = [[] for _ in range(columns)]
    for index, clause in enumerate(constraints.clauses):
        for column in {literal.variable for literal in clause}:
            by_column[column].append(index)
    literals = [literal for clause in constraints.clauses for literal in clause]
    return (
        np.cumsum([0, *map(len, by_column)]).astype(np.int32),
        np.array([index for found in by_column for index in found], np.int32),
        np.cumsum([0, *map(len, constraints.clauses)]).astype(np.int32),
        np.array([literal.variable for literal in literals], np.int32),
        np.array([literal.category for literal in literals], np.int32),
        np.array([literal.equal for literal in literals], np.bool_),
    )


@njit(cache=True)  # type: ignore[untyped-decorator]
def _add_rows(rows: Int32s, planes: Int32s, first: Ints, stride: Int32s, counts: Int32s) -> None:
    """Count the cells of every row."""
    for row in rows:
        for plane in range(len(planes)):
            cell = first[plane]
            for position in range(planes.shape[1]):
                cell += row[planes[plane, position]] * stride[plane, position]
            counts[cell] += 1


@njit(cache=True)  # type: ignore[untyped-decorator]
def _unique_cells(rows: Int32s, planes: Int32s, first: Ints, stride: Int32s, counts: Int32s) -> Ints:
    """(rows,) how many cells each row alone covers."""
    result = np.zeros(len(rows), np.int64)
    for r in range(len(rows)):
        for plane in range(len(planes)):
            cell = first[plane]
            for position in range(planes.shape[1]):
                cell += rows[r, planes[plane, position]] * stride[plane, position]
            result[r] += counts[cell] == 1
    return result


@njit(cache=True)  # type: ignore[untyped-decorator]
def may_change(row: Int32s, column: int, category: int, clauses: Clauses) -> bool:
    """Whether a row still satisfies every clause that names the column, once that has the category."""
    clause_start, clause_of, literal_start, literal_column, literal_category, literal_equal = clauses
    for at in range(clause_start[column], clause_start[column + 1]):
        clause, satisfied = clause_of[at], False
        for x in range(literal_start[clause], literal_start[clause + 1]):
            value = category if literal_column[x] == column else row[literal_column[x]]
            if (value == literal_category[x]) == literal_equal[x]:
                satisfied = True
                break
        if not satisfied:
            return False
    return True


@njit(cache=True)  # type: ignore[untyped-decorator]
def line_of(row: Int32s, column: int, q: int, layout: Layout) -> int:
    """The cell of the column's q-th plane that the row were in if the column had category 0; its others follow at the column's step."""
    base, _, other, other_step = layout
    cell = base[column, q]
    for x in range(other.shape[2]):
        cell += row[other[column, q, x]] * other_step[column, q, x]
    return int(cell)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _best_row(
    starts: Int32s, sizes: Int32s, worth: Int32s, layout: Layout, clauses: Clauses, held: Bools, sweeps: int, seed: int
) -> Int32s:
    """See `Problem.best_row`."""
    np.random.seed(seed)
    n, planes, best_gain = starts.shape[1], layout[0].shape[1], -1
    best = starts[0].copy()
    for start in starts:
        row = start.copy()
        for _ in range(sweeps):
            changed = False
            for column in np.random.permutation(n):
                if not held[column]:
                    changed |= _improve(row, column, sizes[column], worth, layout, clauses)
            if not changed:
                break
        gain = 0
        for column in range(n):
            for q in range(planes):
                gain += worth[line_of(row, column, q, layout) + row[column] * layout[1][column, q]]
        if gain > best_gain:
            best_gain = gain
            best[:] = row
    return best  # type: ignore[no-any-return]


@njit(cache=True)  # type: ignore[untyped-decorator]
def _improve(row: Int32s, column: int, size: int, worth: Int32s, layout: Layout, clauses: Clauses) -> bool:
    """Give a column the category of most worth; whether the row is worth more now. Ties go to a random one."""
    step, gains = layout[1], np.zeros(size, np.int64)
    for q in range(step.shape[1]):
        cell = line_of(row, column, q, layout)
        for category in range(size):
            gains[category] += worth[cell + category * step[column, q]]
    chosen, ties, better = row[column], 1, False
    for category in range(size):
        if category == row[column] or gains[category] < gains[chosen] or not may_change(row, column, category, clauses):
            continue
        if gains[category] > gains[chosen]:
            chosen, ties, better = category, 1, True
        else:
            ties += 1
            if np.random.randint(ties) == 0:
                chosen = category
    row[column] = chosen
    return better


@njit(cache=True)  # type: ignore[untyped-decorator]
def _anneal(
    rows: Int32s, first_free: int, counts: Int32s, planes: Planes, layout: Layout, clauses: Clauses, sizes: Int32s, iterations: int,
    hot: float, cold: float, seed: int,
) -> int:  # fmt: skip
    """See `Problem.anneal`."""
    np.random.seed(seed)
    columns, first, stride = planes
    uncovered = np.flatnonzero(counts == 0).astype(np.int32)
    left = len(uncovered)
    cells, place = np.empty(len(counts), np.int32), np.full(len(counts), -1, np.int32)
    for i in range(left):
        cells[i], place[uncovered[i]] = uncovered[i], i
    cooling, temperature = (cold / hot) ** (1.0 / max(1, iterations)), hot
    for _ in range(iterations):
        if left == 0:
            break
        temperature *= cooling
        cell = cells[np.random.randint(left)]
        plane = np.searchsorted(first, cell, side="right") - 1
        r, column, category, lacking = _nearest(rows, first_free, columns[plane], stride[plane], cell - first[plane], clauses)
        if r < 0 or (lacking > 1 and np.random.random() < SHAKEN):
            # Nothing leads there directly: change a random row.
            r, column = first_free + np.random.randint(len(rows) - first_free), np.random.randint(len(sizes))
            category = np.random.randint(sizes[column])
            if category == rows[r, column] or not may_change(rows[r], column, category, clauses):
                continue
        lost = _lost(rows[r], column, category, counts, layout)
        if lost <= 0 or np.random.random() < np.exp(-lost / temperature):
            left = _exchange_cells(rows[r], column, category, counts, layout, cells, place, left)
            rows[r, column] = category
    return left


@njit(cache=True)  # type: ignore[untyped-decorator]
def _nearest(rows: Int32s, first_free: int, columns: Int32s, stride: Int32s, cell: int, clauses: Clauses) -> tuple[int, int, int, int]:
    """A row that lacks fewest of a cell's categories and may take one of them, that column and category, and how many it lacks.

    cell: its place in the plane of these columns. The row is -1 if none may.
    """
    free, t = len(rows) - first_free, len(columns)
    start = first_free + np.random.randint(free)
    found = (-1, -1, -1, t + 1)
    for offset in range(free):
        r = start + offset
        if r >= len(rows):
            r -= free
        lacking, column, category, rest = 0, -1, -1, cell
        for position in range(t):
            value = rest // stride[position]
            rest -= value * stride[position]
            if rows[r, columns[position]] != value:
                lacking += 1
                if lacking == 1 or np.random.randint(lacking) == 0:
                    column, category = columns[position], value
            if lacking >= found[3]:
                break
        if 0 < lacking < found[3] and may_change(rows[r], column, category, clauses):
            found = (r, column, category, lacking)
            if lacking == 1:
                break
    return found


@njit(cache=True)  # type: ignore[untyped-decorator]
def _lost(row: Int32s, column: int, category: int, counts: Int32s, layout: Layout) -> int:
    """Cells that a change of one category uncovers, less those that it covers."""
    step, old, lost = layout[1], row[column], 0
    for q in range(step.shape[1]):
        cell = line_of(row, column, q, layout)
        lost += counts[cell + old * step[column, q]] == 1
        lost -= counts[cell + category * step[column, q]] == 0
    return lost


@njit(cache=True)  # type: ignore[untyped-decorator]
def _exchange_cells(
    row: Int32s, column: int, category: int, counts: Int32s, layout: Layout, cells: Int32s, place: Int32s, left: int
) -> int:
    """Count a change of one category; keeps the list of uncovered cells, and their places in it, and returns its length."""
    step, old = layout[1], row[column]
    for q in range(step.shape[1]):
        cell = line_of(row, column, q, layout)
        gone, come = cell + old * step[column, q], cell + category * step[column, q]
        counts[gone] -= 1
        if counts[gone] == 0:
            cells[left], place[gone] = gone, left
            left += 1
        if counts[come] == 0:
            left -= 1
            moved = cells[left]
            cells[place[come]], place[moved] = moved, place[come]
            place[come] = -1
        counts[come] += 1
    return left
