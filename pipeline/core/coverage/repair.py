"""The kernels that put a row into a cell and repair the clauses that this breaks."""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.core.constraints import Bools
from pipeline.core.coverage.grid import Clauses, Grid, Int32s


@njit(cache=True)  # type: ignore[untyped-decorator]
def repaired(grid: Grid, row: Int32s, cell: tuple[int, int]) -> bool:
    """Put a row into a cell and change each other column at most once until no clause is broken.

    cell: its plane and its place in the plane. Returns whether that succeeds.
    """
    plane, rest = cell
    # The column that fills up a smaller plane is in it several times.
    clauses, todo = grid.clauses, np.empty(len(row) + grid.planes.shape[1], np.int32)
    held, done, end = np.zeros(len(row), np.bool_), 0, grid.planes.shape[1]
    for position in range(end):
        column = grid.planes[plane, position]
        row[column] = rest // grid.stride[plane, position]
        held[column], todo[position] = True, column
        rest %= grid.stride[plane, position]
    while done < end:
        clause = _broken(row, todo[done], clauses)
        if clause < 0:
            done += 1
            continue
        x = _free_literal(held, clause, clauses)
        if x < 0:
            return False
        column, category = clauses.column[x], clauses.category[x]
        if not clauses.equal[x]:
            if grid.sizes[column] == 1:
                return False
            category = np.random.randint(grid.sizes[column] - 1)
            category += category >= clauses.category[x]
        row[column], held[column], todo[end] = category, True, column
        end += 1
    return True


@njit(cache=True)  # type: ignore[untyped-decorator]
def _broken(row: Int32s, column: int, clauses: Clauses) -> int:
    """A clause that names the column and does not hold; -1 if there is none."""
    for at in range(clauses.start[column], clauses.start[column + 1]):
        clause, satisfied = clauses.of[at], False
        for x in range(clauses.literal_start[clause], clauses.literal_start[clause + 1]):
            satisfied |= (row[clauses.column[x]] == clauses.category[x]) == clauses.equal[x]
        if not satisfied:
            return int(clause)
    return -1


@njit(cache=True)  # type: ignore[untyped-decorator]
def _free_literal(held: Bools, clause: int, clauses: Clauses) -> int:
    """A random literal of the clause whose column is not held; -1 if there is none."""
    chosen, seen = -1, 0
    for x in range(clauses.literal_start[clause], clauses.literal_start[clause + 1]):
        if not held[clauses.column[x]]:
            seen += 1
            if np.random.randint(seen) == 0:
                chosen = x
    return chosen
