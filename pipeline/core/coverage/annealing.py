"""The kernels of covering arrays: greedy rows by coordinate ascent, and simulated annealing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pipeline.core.constraints import Bools
from pipeline.core.coverage.grid import Clauses, Grid, Int32s, Lines, Move, line_of
from pipeline.core.coverage.repair import repaired
from pipeline.core.space import Ints

SHAKEN = 0.2
"""How often a random row is changed if no row is one category away from the cell."""
FORCED = 0.1
"""How often a random row is put into the cell and the clauses that this breaks are repaired."""


class Cover(NamedTuple):
    """The rows in each cell, and the list of uncovered cells.

    counts: (cells,) rows in each cell.
    cells: the uncovered cells, in an array that is longer than the list.
    place: (cells,) place of each cell in the list.
    """

    counts: Int32s
    cells: Int32s
    place: Int32s


class Cooling(NamedTuple):
    """Number of steps of an annealing, and its first and last temperature in cells."""

    iterations: int
    hot: float
    cold: float


@njit(cache=True)  # type: ignore[untyped-decorator]
def add_rows(grid: Grid, rows: Int32s, counts: Int32s) -> None:
    """Count the cells of every row."""
    planes, first, stride = grid.planes, grid.first, grid.stride
    for row in rows:
        for plane in range(len(planes)):
            cell = first[plane]
            for position in range(planes.shape[1]):
                cell += row[planes[plane, position]] * stride[plane, position]
            counts[cell] += 1


@njit(cache=True)  # type: ignore[untyped-decorator]
def unique_cells(grid: Grid, rows: Int32s, counts: Int32s) -> Ints:
    """Number of cells that each row alone covers, (rows,)."""
    planes, first, stride = grid.planes, grid.first, grid.stride
    result = np.zeros(len(rows), np.int64)
    for r in range(len(rows)):
        for plane in range(len(planes)):
            cell = first[plane]
            for position in range(planes.shape[1]):
                cell += rows[r, planes[plane, position]] * stride[plane, position]
            result[r] += counts[cell] == 1
    return result


@njit(cache=True)  # type: ignore[untyped-decorator]
def _may_change(row: Int32s, column: int, category: int, clauses: Clauses) -> bool:
    """Whether a row satisfies every clause of a column after the column takes the category."""
    start, of, literal_start, literal_column, literal_category, equal = clauses
    for at in range(start[column], start[column + 1]):
        clause, satisfied = of[at], False
        for x in range(literal_start[clause], literal_start[clause + 1]):
            value = category if literal_column[x] == column else row[literal_column[x]]
            if (value == literal_category[x]) == equal[x]:
                satisfied = True
                break
        if not satisfied:
            return False
    return True


@njit(cache=True)  # type: ignore[untyped-decorator]
def seed_kernels(seed: int) -> None:
    """Seed the generator that all kernels draw from."""
    np.random.seed(seed)


@njit(cache=True)  # type: ignore[untyped-decorator]
def best_row(grid: Grid, starts: Int32s, worth: Int32s | Ints, held: Bools, sweeps: int) -> Int32s:
    """See `Problem.best_row`."""
    n, best_gain = starts.shape[1], -1
    best = starts[0].copy()
    for start in starts:
        row = start.copy()
        for _ in range(sweeps):
            changed = False
            for column in np.random.permutation(n):
                if not held[column]:
                    changed |= _improve(grid, row, column, worth)
            if not changed:
                break
        gain = 0
        for plane in range(len(grid.planes)):
            cell = grid.first[plane]
            for position in range(grid.planes.shape[1]):
                cell += row[grid.planes[plane, position]] * grid.stride[plane, position]
            gain += worth[cell]
        if gain > best_gain:
            best_gain = gain
            best[:] = row
    return best  # type: ignore[no-any-return]


@njit(cache=True)  # type: ignore[untyped-decorator]
def _improve(grid: Grid, row: Int32s, column: int, worth: Int32s | Ints) -> bool:
    """Give a column its most valuable category; returns whether the row's worth increased.

    Ties are broken at random.
    """
    size, lines, step = grid.sizes[column], grid.lines, grid.lines.step
    gains = np.zeros(size, np.int64)
    for q in range(step.shape[1]):
        cell = line_of(lines, row, column, q)
        for category in range(size):
            gains[category] += worth[cell + category * step[column, q]]
    chosen, ties, better = row[column], 1, False
    for category in range(size):
        if (
            category == row[column]
            or gains[category] < gains[chosen]
            or not _may_change(row, column, category, grid.clauses)
        ):
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
def anneal(grid: Grid, rows: Int32s, counts: Int32s, cooling: Cooling) -> int:
    """See `Problem.anneal`."""
    sizes, columns, first, stride, lines, clauses = grid
    uncovered = np.flatnonzero(counts == 0).astype(np.int32)
    left = len(uncovered)
    cover = Cover(counts, np.empty(len(counts), np.int32), np.full(len(counts), -1, np.int32))
    for i in range(left):
        cover.cells[i], cover.place[uncovered[i]] = uncovered[i], i
    constrained = len(clauses.of) > 0
    factor = (cooling.cold / cooling.hot) ** (1.0 / max(1, cooling.iterations))
    temperature = cooling.hot
    for _ in range(cooling.iterations):
        if left == 0:
            break
        temperature *= factor
        cell = cover.cells[np.random.randint(left)]
        plane = np.searchsorted(first, cell, side="right") - 1
        rest = cell - first[plane]
        if constrained and np.random.random() < FORCED:
            row = rows[np.random.randint(len(rows))]
            left = _force(grid, row, (plane, rest), cover, (left, temperature))
            continue
        r, column, category, lacking = _nearest(rows, columns[plane], stride[plane], rest, clauses)
        if r < 0 or (lacking > 1 and np.random.random() < SHAKEN):
            # No row is one category away from the cell: change a random row.
            r, column = np.random.randint(len(rows)), np.random.randint(len(sizes))
            category = np.random.randint(sizes[column])
            if category == rows[r, column] or not _may_change(rows[r], column, category, clauses):
                continue
        lost = _lost(lines, rows[r], (column, category), counts)
        if lost <= 0 or np.random.random() < np.exp(-lost / temperature):
            left = _exchange_cells(lines, rows[r], (column, category), cover, left)
            rows[r, column] = category
    return left


@njit(cache=True)  # type: ignore[untyped-decorator]
def _force(
    grid: Grid, row: Int32s, cell: tuple[int, int], cover: Cover, state: tuple[int, float]
) -> int:
    """Put a row into a cell, repair the broken clauses, and keep the result by Metropolis' rule.

    cell: its plane and its place in the plane. state: the number of uncovered cells, and the
    temperature in cells. Returns the new number of uncovered cells.
    """
    before, temperature = state
    old, new = row.copy(), row.copy()
    if not repaired(grid, new, cell):
        return before
    left = before
    for column in range(len(row)):
        if new[column] != row[column]:
            left = _exchange_cells(grid.lines, row, (column, new[column]), cover, left)
            row[column] = new[column]
    if left > before and np.random.random() >= np.exp((before - left) / temperature):
        for column in range(len(row)):
            if old[column] != row[column]:
                left = _exchange_cells(grid.lines, row, (column, old[column]), cover, left)
                row[column] = old[column]
    return left


@njit(cache=True)  # type: ignore[untyped-decorator]
def _nearest(
    rows: Int32s, columns: Int32s, stride: Int32s, cell: int, clauses: Clauses
) -> tuple[int, int, int, int]:
    """The row that lacks the fewest of a cell's categories and may take one of them.

    cell: its place in the plane of these columns. Returns the row, the column and category to
    change, and the number of categories that it lacks; the row is -1 if no row may change.
    """
    free, t = len(rows), len(columns)
    start = np.random.randint(free)
    nearest = (-1, -1, -1, t + 1)
    for offset in range(free):
        r = start + offset
        if r >= free:
            r -= free
        lacking, column, category, rest = 0, -1, -1, cell
        for position in range(t):
            value = rest // stride[position]
            rest -= value * stride[position]
            if rows[r, columns[position]] != value:
                lacking += 1
                if lacking == 1 or np.random.randint(lacking) == 0:
                    column, category = columns[position], value
            if lacking >= nearest[3]:
                break
        if 0 < lacking < nearest[3] and _may_change(rows[r], column, category, clauses):
            nearest = (r, column, category, lacking)
            if lacking == 1:
                break
    return nearest


@njit(cache=True)  # type: ignore[untyped-decorator]
def _lost(lines: Lines, row: Int32s, move: Move, counts: Int32s) -> int:
    """Cells that a change of one category uncovers, minus those that it covers."""
    column, category = move
    step, old, lost = lines.step, row[column], 0
    for q in range(step.shape[1]):
        cell = line_of(lines, row, column, q)
        lost += counts[cell + old * step[column, q]] == 1
        lost -= counts[cell + category * step[column, q]] == 0
    return lost


@njit(cache=True)  # type: ignore[untyped-decorator]
def _exchange_cells(lines: Lines, row: Int32s, move: Move, cover: Cover, left: int) -> int:
    """Count a change of one category and update the list of the `left` uncovered cells.

    Returns the new length of the list.
    """
    column, category = move
    counts, cells, place = cover
    step, old = lines.step, row[column]
    for q in range(step.shape[1]):
        cell = line_of(lines, row, column, q)
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
