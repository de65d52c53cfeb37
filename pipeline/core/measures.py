"""Measures of how well a test strategy finds failures (thesis section 4.3)."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from pipeline.core.coverage.projection import Demand, projection_coverage
from pipeline.core.space import Floats, Ints, Space


def failure_sequence(failures: ArrayLike) -> Ints:
    """The accumulated failure sequence Theta (Eq. 4.17).

    Args:
        failures: (n,) in sampling order, whether the KPI is at or below the threshold. An error is
            not a failure, but it used budget and keeps its place.

    Returns:
        (n,) number of failures so far.

    >>> failure_sequence([False, True, True]).tolist()
    [0, 1, 2]
    """
    return np.cumsum(np.asarray(failures, dtype=bool), dtype=np.int64)


def f_measure(theta: Ints, n: int = 1) -> int | None:
    """Number of tests until the n-th failure (Eq. 4.18, 4.19).

    Args:
        theta: failure sequence.
        n: number of the failure, from 1.

    Returns:
        From 1; None if there are fewer failures.

    >>> f_measure(failure_sequence([False, True, True]), n=2)
    3
    """
    if n < 1:
        raise ValueError(f"n must be at least 1, got {n}")
    position = int(np.searchsorted(theta, n))
    return position + 1 if position < len(theta) else None


def c_measure(theta: Ints, baseline: Ints) -> tuple[int, float | None]:
    """Share of tests that a strategy saves against random testing (Eq. 4.20).

    Args:
        theta: failure sequence of the strategy.
        baseline: failure sequence of random testing.

    Returns:
        n, the number of failures of the baseline, and C_n, at most 1. If the baseline has no
        failure, its next test is assumed to be its first one (Eq. 6.2). C_n is None if the
        strategy has fewer than n failures.

    >>> c_measure(failure_sequence([True, True]), failure_sequence([False, True, False, True]))
    (2, 0.5)
    """
    n, reference = baseline_cost(baseline)
    needed = f_measure(theta, n)
    return n, None if needed is None else 1 - needed / reference


def baseline_cost(baseline: Ints) -> tuple[int, int]:
    """n of C_n, and the tests F_n that random testing needed for n failures; see `c_measure`."""
    n = max(int(baseline[-1]) if len(baseline) else 0, 1)
    return n, f_measure(baseline, n) or len(baseline) + 1


def kinds_of(space: Space, failures: Floats) -> int:
    """Number of kinds of failures (n, d)."""
    return len(kinds(space, failures))


def kinds(space: Space, failures: Floats) -> set[tuple[float, ...]]:
    """Distinct combinations of the categorical variables, such as person and pose, of (n, d)."""
    columns = [j for j, variable in enumerate(space.variables) if variable.kind == "categorical"]
    return {tuple(row) for row in failures[:, columns].tolist()}


def feasible_pairs(space: Space) -> int:
    """Number of feasible pairs of categories of different variables."""
    pairs = combinations(range(len(space)), 2)
    return sum(int(space.constraints.feasible_cells(pair).sum()) for pair in pairs)


def pair_coverage(space: Space, points: Floats) -> float:
    """Share of the feasible pairs of categories that points (n, d) cover (thesis section 6.1)."""
    return projection_coverage(space.categorise(points), Demand(space.constraints, 2)).ratio
