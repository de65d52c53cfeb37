"""Groups failures into failure regions: by density on the mixed distance, or as connected failures on the categories."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from sklearn.cluster import DBSCAN

from pipeline.core.distance import mixed_distance
from pipeline.core.space import Floats, Space

Ints = NDArray[np.int64]
NOISE = -1
PROBES = 1200
"""Number of random points from which the distances in a space are estimated."""


def chance_radius(space: Space, failures: int, neighbours: float) -> float:
    """Radius in (0, 1] within which a failure would have this many neighbours on average if all failures were spread evenly over the space.

    Denser clusters are not due to chance, however many failures a campaign found: the radius shrinks as their number grows. neighbours:
    positive.
    """
    if neighbours <= 0:
        raise ValueError(f"neighbours must be positive, got {neighbours}")
    if failures < 2:
        return 1.0
    probes = space.sample(PROBES, np.random.default_rng(0))
    distances = mixed_distance(space, probes, probes)[np.triu_indices(PROBES, 1)]
    radius = float(np.quantile(distances, min(1.0, neighbours / (failures - 1))))
    # With few categories many points coincide: coinciding points form a cluster.
    return radius or float(distances.min(initial=1.0, where=distances > 0)) / 2


def find_regions(space: Space, failures: Floats, epsilon: float, min_failures: int) -> Ints:
    """Label of the density cluster of each failure (n, d), as (n,); -1 for none, larger regions first.

    epsilon: radius on the mixed distance, in (0, 1]. min_failures: failures within it, itself included, that make a failure dense (DBSCAN).
    """
    if not 0 < epsilon <= 1:
        raise ValueError(f"epsilon must be in (0, 1], got {epsilon}")
    if min_failures < 1:
        raise ValueError(f"min_failures must be at least 1, got {min_failures}")
    if not len(failures):
        return np.zeros(0, np.int64)
    found = DBSCAN(eps=epsilon, min_samples=min_failures, metric="precomputed").fit_predict(mixed_distance(space, failures, failures))
    return largest_first(np.asarray(found, dtype=np.int64))


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
    return largest_first(np.asarray(connected_components(neighbours, directed=False)[1], dtype=np.int64))


def medoid(space: Space, points: Floats) -> int:
    """Index of the point (n, d) nearest to all others."""
    return int(np.argmin(mixed_distance(space, points, points).sum(axis=1)))


def largest_first(labels: Ints, min_failures: int = 1) -> Ints:
    """Renumber the labels (n,), larger regions first; regions with fewer than `min_failures` become noise."""
    known, counts = np.unique(labels[labels != NOISE], return_counts=True)
    known, counts = known[counts >= min_failures], counts[counts >= min_failures]
    result = np.full(len(labels), NOISE, np.int64)
    for rank, label in enumerate(known[np.argsort(-counts, kind="stable")]):
        result[labels == label] = rank
    return result
