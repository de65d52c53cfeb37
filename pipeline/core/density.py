"""Density clusters of failures over the variables and the attributes of their values.

Attributes make similar people count as close.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pipeline.core.distance import mixed_distance
from pipeline.core.regions import largest_first
from pipeline.core.space import Floats, Ints, Space

PROBES = 1200
"""Number of random points from which the distances in a space are estimated."""


def described_distance(space: Space, a: Floats, b: Floats) -> Floats:
    """Distance of every point of `a` (n, d) to every point of `b` (m, d), as (n, m) in [0, 1].

    The mixed distance, except for categorical variables with attributes: two values differ by the
    mean over the attributes of their difference, divided by the largest one, instead of 0 or 1.
    """
    total = mixed_distance(space, a, b)
    for j, variable in enumerate(space.variables):
        if not variable.attributes:
            continue
        numbers = np.array([numbers for _, numbers in variable.attributes])
        spans = np.maximum(np.ptp(numbers, axis=1), 1e-12)
        differences = np.abs(numbers[:, :, None] - numbers[:, None, :]) / spans[:, None, None]
        first, second = a[:, j].astype(np.int64), b[:, j].astype(np.int64)
        unlike = differences.mean(axis=0)[first[:, None], second]
        total += (unlike - (first[:, None] != second)) / len(space)
    return total


def described_radius(space: Space, failures: int, neighbours: float) -> float:
    """Radius within which a failure has some neighbours by chance.

    Denser clusters are not due to chance, however many failures there are: the radius shrinks as
    their number grows.

    Args:
        space: of the failures.
        failures: their number.
        neighbours: mean number of neighbours if all failures were spread evenly over the space,
            above 0.

    Returns:
        The radius on the described distance, in [0, 1].

    Raises:
        ValueError: `neighbours` is not positive.
    """
    if neighbours <= 0:
        raise ValueError(f"neighbours must be positive, got {neighbours}")
    if failures < 2:
        return 1.0
    return float(np.quantile(_chance_distances(space), min(1.0, neighbours / (failures - 1))))


@lru_cache(maxsize=8)
def _chance_distances(space: Space) -> Floats:
    """Distances between random points, (n,)."""
    probes = space.sample(PROBES, np.random.default_rng(0))
    return np.asarray(described_distance(space, probes, probes)[np.triu_indices(PROBES, 1)])


def dense_groups(space: Space, failures: Floats, radius: float, min_failures: int) -> Ints:
    """Density clusters of failures (DBSCAN).

    Args:
        space: of the failures.
        failures: (n, d) points.
        radius: on the described distance.
        min_failures: failures within the radius, itself included, that make a failure dense.

    Returns:
        (n,) label of each failure's cluster, larger clusters first; -1 for none.
    """
    if not len(failures):
        return np.zeros(0, np.int64)
    # The import takes more than a second, and steps that only read regions need none of it.
    from sklearn.cluster import DBSCAN

    # DBSCAN needs a positive radius; if many points coincide, coinciding points form a cluster.
    clusters = DBSCAN(eps=max(radius, 1e-9), min_samples=min_failures, metric="precomputed")
    distances = np.maximum(described_distance(space, failures, failures), 0)
    return largest_first(np.asarray(clusters.fit_predict(distances), dtype=np.int64))
