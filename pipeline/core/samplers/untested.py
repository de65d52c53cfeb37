"""Points that no test has executed yet, as new tests should be (thesis 4.4.2 and 4.4.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.core.space import Floats, Space

DRAWS = 1000
"""Random points among which `fill` looks for untested ones."""


def executed(points: Floats, tested: Floats) -> NDArray[np.bool_]:
    """Whether each of (n, d) points equals a row of `tested` (m, d), (n,)."""
    keys = set(_keys(tested))
    return np.array([key in keys for key in _keys(points)], dtype=bool)


def untested(points: Floats, tested: Floats) -> NDArray[np.bool_]:
    """Whether each point equals no tested point and no point before it.

    Args:
        points: (n, d).
        tested: (m, d).

    Returns:
        (n,).

    >>> untested(np.array([[1.0], [1.0], [2.0]]), np.array([[2.0]])).tolist()
    [True, False, False]
    """
    seen, new = set(_keys(tested)), np.zeros(len(points), dtype=bool)
    for i, key in enumerate(_keys(points)):
        new[i] = key not in seen
        seen.add(key)
    return new


def fill(
    space: Space, chosen: Floats, tested: Floats, count: int, rng: np.random.Generator
) -> Floats:
    """Fill up a batch with random points: untested ones as far as a draw has them, then others.

    Args:
        space: to draw from.
        chosen: (n, d) points of the batch.
        tested: (m, d) points that have been tested.
        count: size of the batch.
        rng: source of all random draws.

    Returns:
        (count, d) points, the chosen ones first.
    """
    missing = count - len(chosen)
    if missing <= 0:
        return chosen[:count]
    drawn = space.sample(max(missing, DRAWS), rng)
    new = untested(drawn, np.concatenate([tested, chosen]))
    order = np.argsort(~new, kind="stable")
    return np.concatenate([chosen, drawn[order[:missing]]])


def _keys(points: Floats) -> list[bytes]:
    return [row.tobytes() for row in np.ascontiguousarray(points + 0.0)]  # -0.0 becomes 0.0.
