"""Connected failures, the exact failure regions of the thesis (Def. 4.18, 4.19), and the medoid and numbering of any groups.

The definition needs no radius and no threshold, so the number of connected sets stands in each result as the reference. But on categories
a sparse search leaves most failures alone; `pipeline.core.density` therefore proposes the regions that people read.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from pipeline.core.distance import mixed_distance
from pipeline.core.space import Floats, Ints, Space

NOISE = -1


def connected_failures(space: Space, failures: Floats) -> Ints:
    """Label of the set of connected failures (Def. 4.19) that each failure (n, d) belongs to, as (n,), larger sets first.

    On the categories: neighbours agree in all variables but one and are adjacent in that one (cyclic variables wrap around; any two values
    of a categorical variable are adjacent).
    """
    if not len(failures):
        return np.zeros(0, np.int64)
    categories = space.categorise(failures)
    different = np.zeros((len(failures), len(failures)), np.int64)
    far = np.zeros(different.shape, bool)
    for j, variable in enumerate(space.variables):
        step = np.abs(categories[:, None, j] - categories[None, :, j])
        if variable.cyclic:
            step = np.minimum(step, variable.size - step)
        different += step > 0
        if variable.kind != "categorical":
            far |= step > 1
    neighbours = csr_matrix((different <= 1) & ~far)
    return largest_first(
        np.asarray(connected_components(neighbours, directed=False)[1], dtype=np.int64)
    )


def medoid(space: Space, points: Floats) -> int:
    """Index of the point (n, d) nearest to all others."""
    return int(np.argmin(mixed_distance(space, points, points).sum(axis=1)))


def largest_first(labels: Ints) -> Ints:
    """Renumber the labels (n,), larger regions first; noise stays noise."""
    known, counts = np.unique(labels[labels != NOISE], return_counts=True)
    result = np.full(len(labels), NOISE, np.int64)
    for rank, label in enumerate(known[np.argsort(-counts, kind="stable")]):
        result[labels == label] = rank
    return result
