"""Points with unknown categories, encoded as -1."""

from __future__ import annotations

import numpy as np

from pipeline.core.constraints import Constraints, satisfied
from pipeline.core.variable import Ints


def broken_clauses(constraints: Constraints, points: Ints) -> Ints:
    """The first clause that each point breaks.

    A point with unknown categories may break no single clause and still have no feasible
    completion; then it gets the number of clauses.

    Args:
        constraints: over d variables.
        points: (n, d) category indices, -1 for unknown.

    Returns:
        (n,) indices of clauses; -1 for a point that is feasible or can become so.
    """
    broken = np.full(len(points), -1, np.int64)
    for index, clause in reversed(list(enumerate(constraints.clauses))):
        broken[~satisfied(clause, points)] = index
    named = sorted(constraints.named)
    unsure = (broken < 0) & (points[:, named] < 0).any(axis=1)
    if unsure.any():
        different, where = np.unique(points[unsure][:, named], axis=0, return_inverse=True)
        possible = []
        for row in different.tolist():
            fixed = {v: c for v, c in zip(named, row, strict=True) if c >= 0}
            possible.append(constraints.satisfiable(fixed))
        broken[unsure] = np.where(np.array(possible)[where], -1, len(constraints.clauses))
    return broken
