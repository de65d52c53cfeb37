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
    """Independent draws that keep the constraints.

    Each place takes its first draw that holds. A round draws once for each place that is still
    empty, or several times where fewer than one draw in ten holds, so that narrow constraints need
    few rounds.

    Args:
        draw: makes (n, d) independent draws.
        holds: whether each of them keeps the constraints, (n,).
        count: number of draws.
        whole: what the constraints exclude almost all of if this fails, for the message.

    Returns:
        (count, d) draws.

    Raises:
        InputError: none of `MAX_DRAWS` draws holds.
    """
    points = draw(count)
    missing = np.flatnonzero(~holds(points))
    drawn, kept = count, count - len(missing)
    while len(missing):
        if not kept and drawn >= MAX_DRAWS:
            raise InputError(
                f"constraints: they exclude almost {whole}: "
                f"none of {drawn} random points satisfies them"
            )
        tries = max(1, min(drawn // (10 * (kept + 1)), BLOCK // len(missing)))
        block = draw(len(missing) * tries)
        good = holds(block).reshape(len(missing), tries)
        drawn, kept = drawn + len(block), kept + int(good.sum())
        hit, first = good.any(axis=1), good.argmax(axis=1)
        points[missing[hit]] = block.reshape(len(missing), tries, -1)[hit, first[hit]]
        missing = missing[~hit]
    return points
