"""Points with unknown categories, encoded as -1."""

from __future__ import annotations

import numpy as np

from pipeline.core.constraints import Constraints, satisfied
from pipeline.core.variable import Ints


def broken_clauses(constraints: Constraints, points: Ints) -> Ints:
    """Index of the first clause that each of (n, d) points breaks, (n,); -1 for a point that is feasible or can become so.

    A point with unknown categories may break no single clause and still have no feasible completion; then it gets the number of clauses.
    """
    found = np.full(len(points), -1, np.int64)
    for index, clause in reversed(list(enumerate(constraints.clauses))):
        found[~satisfied(clause, points)] = index
    named = sorted(constraints.named)
    unsure = (found < 0) & (points[:, named] < 0).any(axis=1)
    if unsure.any():
        different, where = np.unique(points[unsure][:, named], axis=0, return_inverse=True)
        possible = [
            constraints.satisfiable({v: int(c) for v, c in zip(named, row, strict=True) if c >= 0})
            for row in different
        ]
        found[unsure] = np.where(np.array(possible)[where], -1, len(constraints.clauses))
    return found
