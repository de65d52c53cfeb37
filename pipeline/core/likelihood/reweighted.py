"""Uniform random tests, weighted by how often the road shows each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.core.exposure import Exposure
from pipeline.core.likelihood.rate import Rate, bounded
from pipeline.core.space import Floats

TINY = 1e-9
"""In place of a weight of 0, so that the limits are 0 and 1."""


def reweighted(
    exposure: Exposure, points: Floats, failed: NDArray[np.bool_], errors: int = 0
) -> Rate:
    """The failure rate under an exposure from independent uniform tests of its space.

    Each test has the weight exposure / uniform: a test that the road shows often counts for many.
    The interval holds whatever weights unseen failures have, so it is wide where few tests have
    most of the weight. With errors, the rate covers error-free conditions only, which may be rarer
    or more frequent on the road than in uniform tests. With constraints, the weights are certain up
    to a factor, so they are divided by their mean.

    Args:
        exposure: how often the road shows each point.
        points: (n, d) tests without an error, n at least 1.
        failed: (n,) whether each failed.
        errors: number of tests with an error.

    Raises:
        ValueError: without tests.
    """
    if not len(points):
        raise ValueError("expected at least one test without an error")
    weights = exposure.ratio(points)
    worth = weights.sum() ** 2 / max(float(weights @ weights), 1e-300)
    tests = max(float(weights.sum()), TINY) if errors or exposure.space.clauses else len(points)
    limits = bounded(weights[failed], exposure.largest_ratio, tests)
    note = f"under this exposure, {len(points):,} uniform tests are worth {worth:,.0f}"
    value = min(1.0, float(weights[failed].sum()) / tests)
    return Rate(value, limits, len(points), int(failed.sum()), errors, note)
