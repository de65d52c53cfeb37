"""Lower bounds of the size of covering arrays."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import comb, prod

from pipeline.core.constraints import Constraints


def lower_bound(sizes: Sequence[int], strength: int, constraints: Constraints | None = None) -> int:
    """A lower bound of the rows of a covering array.

    A row covers one cell of each plane, so the plane with the most feasible cells is a bound.
    Without constraints there are two more: binary columns need as many rows as Kleitman and
    Spencer's theorem says (1973), and the rows that share a category of one column cover all other
    columns with strength t - 1.

    Args:
        sizes: number of categories of each column.
        strength: t, in [1, len(sizes)].
        constraints: over the same columns, perhaps with one more.

    >>> lower_bound((4, 3, 3), 2), lower_bound((2,) * 11, 2)
    (12, 7)
    """
    if constraints is not None and constraints.clauses:
        cells_of, best = {}, 0
        for plane in combinations(range(len(sizes)), strength):
            cells_of[plane] = prod(sizes[column] for column in plane)
        for plane in sorted(cells_of, key=lambda plane: -cells_of[plane]):
            if cells_of[plane] <= best:
                break
            best = max(best, int(constraints.feasible_cells(plane).sum()))
        return best
    ordered = sorted(sizes, reverse=True)
    if strength == 1:
        return ordered[0]
    bound = prod(ordered[:strength])
    if strength > 2:
        return max(bound, ordered[0] * lower_bound(ordered[1:], strength - 1))
    # Kleitman and Spencer: the smallest N with C(N - 1, ceil(N / 2)) >= columns.
    columns, rows = sum(size >= 2 for size in sizes), 1
    while comb(rows - 1, -(-rows // 2)) < columns:
        rows += 1
    return max(bound, rows if columns > 1 else 2 * columns)
