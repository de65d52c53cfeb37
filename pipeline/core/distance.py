"""The distance between points of a scenario space, and the relevance score based on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.core.space import Floats, Space


def mixed_distance(space: Space, a: Floats, b: Floats) -> Floats:
    """Distance of every point of `a` to every point of `b`.

    The mean over variables of the difference divided by the largest possible difference: the
    range, or half the period of a cyclic variable; categorical variables contribute 0 or 1.

    Args:
        space: of the points.
        a: (n, d) points.
        b: (m, d) points.

    Returns:
        (n, m) in [0, 1].
    """
    total = np.zeros((len(a), len(b)))
    for column, variable in enumerate(space.variables):
        first, second = a[:, column, None], b[None, :, column]
        if variable.kind == "categorical":
            total += first != second
            continue
        span = variable.high - variable.low
        difference = np.abs(first - second)
        if variable.cyclic:
            difference, span = np.minimum(difference, span - difference), span / 2
        total += difference / span
    return total / len(space)


def relevance(
    space: Space, candidates: Floats, points: Floats, failures: NDArray[np.bool_], epsilon: float
) -> NDArray[np.int64]:
    """The score omega of each candidate (Def. 4.20): nearby passing tests minus nearby failures.

    A candidate is sampling-relevant while its score is above a negative threshold; below it, the
    candidate lies in an established failure region.

    Args:
        space: of the points.
        candidates: (n, d) points.
        points: (m, d) observed tests.
        failures: (m,) whether each of these tests failed.
        epsilon: distance below which a test is nearby.

    Returns:
        (n,) scores.
    """
    signs = np.where(failures, -1, 1)
    ball = mixed_distance(space, candidates, points) < epsilon
    return np.asarray(ball @ signs, dtype=np.int64)
