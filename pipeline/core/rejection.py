"""Rejection sampling: draws that satisfy a condition, however few do."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError

MAX_DRAWS = 1_000_000
"""Draws without a single feasible one after which there count as none."""
BLOCK = 100_000
"""Draws at once."""
Floats = NDArray[np.float64]


def feasible(
    draw: Callable[[int], Floats],
    holds: Callable[[Floats], NDArray[np.bool_]],
    count: int,
    whole: str,
) -> Floats:
    """(count, d) independent draws that keep the constraints.

    draw: makes (n, d) independent draws. holds: whether each keeps the constraints, (n,). whole: of which the constraints leave almost
    nothing if this fails.

    Each place takes its first draw that holds. A round draws once for each place that still has none, or several times where fewer than
    one draw in ten holds, so that narrow constraints need few rounds.

    Raises InputError if none of `MAX_DRAWS` draws holds.
    """
    points = draw(count)
    missing = np.flatnonzero(~holds(points))
    drawn, found = count, count - len(missing)
    while len(missing):
        if not found and drawn >= MAX_DRAWS:
            raise InputError(
                f"constraints: they exclude almost {whole}: none of {drawn} random points satisfies them"
            )
        tries = max(1, min(drawn // (10 * (found + 1)), BLOCK // len(missing)))
        block = draw(len(missing) * tries)
        good = holds(block).reshape(len(missing), tries)
        drawn, found, hit = drawn + len(block), found + int(good.sum()), good.any(axis=1)
        points[missing[hit]] = block.reshape(len(missing), tries, -1)[hit, good[hit].argmax(axis=1)]
        missing = missing[~hit]
    return points
