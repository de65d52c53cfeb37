"""Pairs of categories that tests and failures cover, for each two variables of a space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.coverage.projection import Demand, planes
from pipeline.core.space import Floats, Space


@dataclass(frozen=True)
class PairShare:
    """Two variables and their feasible pairs of categories.

    Attributes:
        feasible: Number of feasible pairs.
        tests: Number of them that a test covers.
        failures: Number of them that a failure covers.
    """

    first: str
    second: str
    feasible: int
    tests: int
    failures: int


def pair_shares(space: Space, points: Floats, failed: NDArray[np.bool_]) -> tuple[PairShare, ...]:
    """Covered pairs of categories for every two variables, in the order of the space.

    The sums over all variables are those of the pair coverage (thesis section 6.1).

    Args:
        space: The scenario space.
        points: Valid tests, (n, d).
        failed: Whether each test fails, (n,).

    Returns:
        A share for every two variables with a feasible pair.
    """
    demand = Demand(space.constraints, 2)
    by_tests, by_failures = demand.counts(), demand.counts()
    by_tests.add(space.categorise(points))
    by_failures.add(space.categorise(points[failed]))
    both = zip(planes(by_tests, demand), planes(by_failures, demand), strict=True)
    return tuple(
        PairShare(
            first=space.names[plane.variables[0]],
            second=space.names[plane.variables[1]],
            feasible=int(plane.feasible.sum()),
            tests=int((plane.counts[plane.feasible] > 0).sum()),
            failures=int((other.counts[other.feasible] > 0).sum()),
        )
        for plane, other in both
        if plane.feasible.any()
    )
