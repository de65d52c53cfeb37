"""Density clusters of failures over the variables and the attributes of their values: similar people count as close."""

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

    The mixed distance, but two values of a categorical variable with attributes differ by the mean over its attributes of their difference,
    divided by the largest one, instead of by 0 or 1.
    """
    total = mixed_distance(space, a, b)
    for j, variable in enumerate(space.variables):
        if variable.attributes:
            first, second = a[:, j].astype(np.int64), b[:, j].astype(np.int64)
            total += (
                _unlike(variable.attributes)[first[:, None], second] - (first[:, None] != second)
            ) / len(space)
    return total


def _unlike(attributes: tuple[tuple[str, tuple[float, ...]], ...]) -> Floats:
    """Mean difference of the attributes of each two values, (v, v) in [0, 1]."""
    numbers = np.array([numbers for _, numbers in attributes])
    spans = np.maximum(np.ptp(numbers, axis=1), 1e-12)
    return np.asarray(
        (np.abs(numbers[:, :, None] - numbers[:, None, :]) / spans[:, None, None]).mean(axis=0)
    )


def described_radius(space: Space, failures: int, neighbours: float) -> float:
    """Radius in [0, 1] within which a failure would have this many neighbours on average if all failures were spread evenly over the space.

    Denser clusters are not due to chance, however many failures were found: the radius shrinks as their number grows. neighbours: positive.
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
    """Label of the density cluster (DBSCAN) of each failure (n, d), as (n,); -1 for none, larger clusters first.

    radius: on the described distance. min_failures: failures within it, itself included, that make a failure dense.
    """
    if not len(failures):
        return np.zeros(0, np.int64)
    from sklearn.cluster import (
        DBSCAN,
    )  # Takes more than a second, and steps that only read regions find none.

    # DBSCAN asks for a positive radius; if many points coincide, coinciding points form a cluster.
    found = DBSCAN(eps=max(radius, 1e-9), min_samples=min_failures, metric="precomputed")
    return largest_first(
        np.asarray(
            found.fit_predict(np.maximum(described_distance(space, failures, failures), 0)),
            dtype=np.int64,
        )
    )
