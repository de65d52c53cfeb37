"""Connected failures, and the medoid and numbering of any groups of failures.

Connected failures are the exact failure regions of the thesis (Def. 4.18, 4.19). The definition
needs no radius and no threshold, so the number of connected sets stands in each result as the
reference. But on categories a sparse search leaves most failures alone, so `pipeline.core.density`
proposes the regions that people read.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from pipeline.core.distance import mixed_distance
from pipeline.core.space import Floats, Ints, Space

NOISE = -1


def connected_failures(space: Space, failures: Floats) -> Ints:
    """The sets of connected failures (Def. 4.19), on the categories.

    Neighbours agree in all variables but one and are adjacent in that one: cyclic variables wrap
    around, and any two values of a categorical variable are adjacent.

    Args:
        space: of the failures.
        failures: (n, d) points.

    Returns:
        (n,) label of the set that each failure belongs to; 0 is the largest set.

    >>> from pipeline.core.space import Variable
    >>> fog = Variable("fog", "continuous", "%", low=0, high=100, step=10)
    >>> connected_failures(Space((fog,)), np.array([[0.0], [50.0], [60.0]])).tolist()
    [1, 0, 0]
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
    _, labels = connected_components(neighbours, directed=False)
    return largest_first(np.asarray(labels, dtype=np.int64))


def medoid(space: Space, points: Floats) -> int:
    """Index of the point (n, d) with the smallest mean distance to all points."""
    return int(np.argmin(mixed_distance(space, points, points).sum(axis=1)))


def largest_first(labels: Ints) -> Ints:
    """Renumber the labels (n,), larger regions first; noise stays noise.

    >>> largest_first(np.array([5, 7, 7, NOISE])).tolist()
    [1, 0, 0, -1]
    """
    distinct, counts = np.unique(labels[labels != NOISE], return_counts=True)
    result = np.full(len(labels), NOISE, np.int64)
    for rank, label in enumerate(distinct[np.argsort(-counts, kind="stable")]):
        result[labels == label] = rank
    return result
