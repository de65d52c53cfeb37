"""Points that no test has executed yet, as the thesis demands of new tests (sections 4.4.2 and 4.4.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.core.space import Floats, Space

DRAWS = 1000
"""Random points among which `fill` looks for untested ones."""


def executed(points: Floats, tested: Floats) -> NDArray[np.bool_]:
    """Whether each of (n, d) points equals a row of `tested` (m, d), (n,)."""
    known = set(_keys(tested))
    return np.array([key in known for key in _keys(points)], dtype=bool)


def untested(points: Floats, tested: Floats) -> NDArray[np.bool_]:
    """Whether each of (n, d) points equals no row of `tested` (m, d) and none of the points before it, (n,)."""
    seen, new = set(_keys(tested)), np.zeros(len(points), dtype=bool)
    for i, key in enumerate(_keys(points)):
        new[i] = key not in seen
        seen.add(key)
    return new


def fill(
    space: Space, chosen: Floats, tested: Floats, count: int, rng: np.random.Generator
) -> Floats:
    """The (n, d) chosen points and random ones, `count` in total: untested ones as far as a draw has them, then repetitions."""
    missing = count - len(chosen)
    if missing <= 0:
        return chosen[:count]
    drawn = space.sample(max(missing, DRAWS), rng)
    new = untested(drawn, np.concatenate([tested, chosen]))
    order = np.argsort(~new, kind="stable")
    return np.concatenate([chosen, drawn[order[:missing]]])


def _keys(points: Floats) -> list[bytes]:
    return [row.tobytes() for row in np.ascontiguousarray(points + 0.0)]  # -0.0 becomes 0.0.
