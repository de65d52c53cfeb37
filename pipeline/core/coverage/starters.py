"""The kernels that anneal the starter rows of symmetric arrays."""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.core.coverage.grid import Int32s, Lines, Move, line_of


@njit(cache=True)  # type: ignore[untyped-decorator]
def anneal_starters(
    lines: Lines,
    of_cell: Int32s,
    counts: Int32s,
    rows: Int32s,
    plan: tuple[int, int, float, float],
    seed: int,
) -> int:
    """Change single categories of `rows`, in place, until they cover every class of cells.

    Args:
        lines: of the problem.
        of_cell: (cells,) class of each cell.
        counts: (classes,) counts of the rows and of fixed ones; updated.
        rows: (m, n), changed in place.
        plan: number of categories, number of steps, first and last temperature.
        seed: seed of the random draws.

    Returns:
        The number of classes left uncovered.
    """
    np.random.seed(seed)
    categories, steps, temperature, cold = plan
    factor, left = (cold / temperature) ** (1.0 / max(1, steps)), 0
    for count in counts:
        left += count == 0
    for _ in range(steps):
        if left == 0:
            break
        temperature *= factor
        row, column = rows[np.random.randint(len(rows))], np.random.randint(rows.shape[1])
        old, category = row[column], np.random.randint(categories - 1)
        category += category >= old
        more = _exchange_classes(lines, of_cell, counts, row, (column, category))
        if more <= 0 or np.random.random() < np.exp(-more / temperature):
            left += more
        else:
            _exchange_classes(lines, of_cell, counts, row, (column, old))
    return int(left)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _exchange_classes(
    lines: Lines, of_cell: Int32s, counts: Int32s, row: Int32s, move: Move
) -> int:
    """Make a change of one category; returns the change in the number of uncovered classes."""
    column, category = move
    step, old, more = lines.step, row[column], 0
    for q in range(step.shape[1]):
        cell = line_of(lines, row, column, q)
        gone = of_cell[cell + old * step[column, q]]
        come = of_cell[cell + category * step[column, q]]
        counts[gone] -= 1
        more += counts[gone] == 0
        more -= counts[come] == 0
        counts[come] += 1
    row[column] = category
    return more
