"""A search that knows where tests fail: the bound that the pair coverage of failures is compared with."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from worlds import World

from pipeline.core.samplers.mutations import mutate
from pipeline.core.space import Floats, Ints, Space

RANDOM, ROUNDS, MUTANTS = 20_000, 4, 10_000
"""Points tried: at random, then in rounds of failures with one variable drawn anew."""


def known_failures(world: World, threshold_s: float) -> Floats:
    """Many failures of a world, (m, d). Mutations reach more of them than random points where failures are rare."""
    rng = np.random.default_rng(3)
    tried = world.space.sample(RANDOM, rng)
    failures = _failing(world, tried, threshold_s)
    for _ in range(ROUNDS if len(failures) else 0):
        parents = failures[rng.integers(len(failures), size=MUTANTS)]
        failures = np.concatenate(
            [failures, _failing(world, mutate(world.space, parents, rng, most=1), threshold_s)]
        )
    return np.unique(failures, axis=0)


def greedy(space: Space, failures: Floats, tests: int) -> Floats:
    """Up to `tests` of (m, d) failures, each the one that covers most pairs of categories not yet covered, (n, d)."""
    cells, chosen = _pairs(space, failures), []
    wanted = np.ones(int(cells.max(initial=-1)) + 1, bool)
    free = np.ones(len(failures), bool)
    for _ in range(min(tests, len(failures))):
        best = int(np.argmax(np.where(free, wanted[cells].sum(axis=1), -1)))
        wanted[cells[best]], free[best] = False, False
        chosen.append(best)
    return failures[chosen]


def _failing(world: World, points: Floats, threshold_s: float) -> Floats:
    parts = np.array_split(points, max(1, len(points) // 2000))
    return np.concatenate([part[world.kpi(part) <= threshold_s] for part in parts])


def _pairs(space: Space, points: Floats) -> Ints:
    """The number of each pair of categories of (m, d) points, (m, pairs)."""
    categories, columns, offset = space.categorise(points), [], 0
    for first, second in combinations(range(len(space)), 2):
        columns.append(offset + categories[:, first] * space.sizes[second] + categories[:, second])
        offset += space.sizes[first] * space.sizes[second]
    return np.column_stack(columns)
