"""Covering arrays: few feasible rows that contain every feasible combination of t categories."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from itertools import combinations

import numpy as np

from pipeline.core.constraints import Constraints
from pipeline.core.coverage.bounds import lower_bound
from pipeline.core.coverage.mixed import STRONGEST, Mixed, all_planes, copy_for
from pipeline.core.coverage.problem import lay_out
from pipeline.core.coverage.search import Limit, Search
from pipeline.core.space import Ints
from pipeline.errors import InputError

Progress = Callable[[float, int, int], None]
"""Called with the share done, the current number of rows and the lower bound.

The share is that of the cells; when polishing, that of the time."""
QUICK_OPERATIONS = 3e8
"""Elementary annealing steps for a quick array.

A fixed number, so the same seed gives the same rows on any machine."""
MOST_ROWS = 100_000
"""Rows of an array, at most: these take about a minute; time and memory grow with the cells."""


@dataclass(frozen=True)
class Effort:
    """How long to search for a small array.

    Args:
        polish_s: time limit in seconds, > 0. The search stops early at the lower bound. With None
            it runs a fixed number of steps, so results are reproducible.
        progress: called during the search.
        processor: whether the limit is on processor time, which other programs do not use up.

    Raises:
        ValueError: if polish_s is not positive.
    """

    polish_s: float | None = None
    progress: Progress | None = None
    processor: bool = False

    def __post_init__(self) -> None:
        if self.polish_s is not None and not self.polish_s > 0:
            raise ValueError(f"polish_s must be positive, got {self.polish_s}")

    def clock(self) -> float:
        """Now, in seconds of the time that is limited."""
        return time.process_time() if self.processor else time.monotonic()


QUICK = Effort()


@dataclass(frozen=True)
class CoveringArray:
    """A covering array.

    Attributes:
        rows: (n, d) category indices.
        strength: t.
        cells: number of feasible cells that are wanted, all covered.
        lower_bound: no array has fewer rows.
    """

    rows: Ints
    strength: int
    cells: int
    lower_bound: int

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.rows)


def covering_array(
    constraints: Constraints,
    strength: int | Mixed = 2,
    *,
    seeds: Ints | None = None,
    seed: int = 0,
    effort: Effort = QUICK,
) -> CoveringArray:
    """Search for a small covering array over the variables of `constraints`.

    Args:
        constraints: sizes of the d variables, and what is feasible.
        strength: t, in [1, 6], alone or with more planes.
        seeds: (m, d) rows that the array starts with.
        seed: seed of all random draws, from 0.
        effort: how long to search.

    Raises:
        ValueError: for contradictory constraints, an infeasible seed row or a strength out of
            range.
        InputError: if the array needs more than `MOST_ROWS` rows.

    >>> array = covering_array(Constraints((2, 2, 2)), strength=2)
    >>> array.size, array.cells, array.lower_bound
    (4, 12, 4)
    """
    sizes, mixed = constraints.sizes, Mixed(strength) if isinstance(strength, int) else strength
    if not 1 <= mixed.strength <= min(STRONGEST, len(sizes)):
        raise ValueError(
            f"strength must be in [1, {min(STRONGEST, len(sizes))}], got {mixed.strength}"
        )
    planes = all_planes(len(sizes), mixed)
    limits = copy_for(constraints, planes)
    if not limits.satisfiable({}):
        clauses = ", ".join(map(str, limits.contradiction()))
        raise ValueError(f"clauses {clauses} contradict each other: no row is feasible")
    given = np.zeros((0, len(sizes)), np.int32) if seeds is None else np.asarray(seeds, np.int32)
    if (given < 0).any():
        raise ValueError("seed rows need a category for each variable")
    given = np.pad(given, ((0, 0), (0, len(limits.sizes) - len(sizes))))
    if broken := limits.first_broken(given.astype(np.int64)):
        raise ValueError(f"seed row {broken[0]} breaks clause {broken[1]}")
    started = effort.clock()
    bound = lower_bound(sizes, mixed.strength, limits)
    if not limits.clauses:  # With constraints, the emptiest plane decides, see below.
        for named in mixed.extras.planes:
            bound = max(bound, lower_bound([sizes[v] for v in named.variables], named.strength))
    if bound > MOST_ROWS:
        needed = f"a plan needs at least {bound:,} points, at most {MOST_ROWS:,} can be planned"
        raise InputError(f"{needed}; take fewer values or a lower strength")

    def covering(share: float, size: int) -> None:
        if effort.progress is not None:
            effort.progress(share if effort.polish_s is None else 0.0, size, bound)

    search = Search(lay_out(limits, planes), limits, given, np.random.default_rng(seed), covering)
    # Besides the seed rows, the array needs a row for each uncovered cell of the emptiest plane.
    left = np.add.reduceat(search.problem.counts(given) == 0, search.problem.first, dtype=np.int64)
    bound = max(bound, len(given) + int(left.max()))
    if effort.polish_s is None:
        rows = search.shorten(search.start(), bound, operations=QUICK_OPERATIONS)
    else:
        limit = _limit(effort.polish_s, effort, started, bound)
        rows = search.polish(search.start(lambda: limit.spent() < limit.seconds), bound, limit)
    categories = rows[:, : len(sizes)].astype(np.int64)
    cells = int(search.problem.required.sum())
    return CoveringArray(categories, mixed.strength, cells, min(bound, len(rows)))


def _limit(seconds: float, effort: Effort, started: float, bound: int) -> Limit:
    def spent() -> float:
        return effort.clock() - started

    def tell(size: int) -> None:
        if effort.progress is not None:
            effort.progress(min(1.0, spent() / seconds), size, bound)

    return Limit(seconds, spent, tell)


def order_by_new_pairs(rows: Ints) -> Ints:
    """Order rows so that each next row covers the most new pairs of categories.

    Args:
        rows: (n, d) category indices.

    Returns:
        (n,) indices of rows; ties keep the order of the rows.

    >>> order_by_new_pairs(np.array([[0, 0], [0, 0], [1, 1]])).tolist()
    [0, 2, 1]
    """
    # Number every pair of categories: (n, d (d - 1) / 2).
    pairs = list(combinations(range(rows.shape[1]), 2))
    keys = np.zeros((len(rows), len(pairs)), dtype=np.int64)
    offset = 0
    for position, (first, second) in enumerate(pairs if len(rows) else []):
        size = rows[:, second].max() + 1
        keys[:, position] = offset + rows[:, first] * size + rows[:, second]
        offset += (rows[:, first].max() + 1) * size
    covered = np.zeros(int(keys.max(initial=-1)) + 1, dtype=bool)
    # Gains only fall as pairs get covered, so a stale gain is an upper bound: only the head of the
    # heap is counted again.
    heap = [(-keys.shape[1], row) for row in range(len(rows))]
    heapify(heap)
    order: list[int] = []
    while heap:
        bound, row = heappop(heap)
        gain = int(np.sum(~covered[keys[row]]))
        if gain < -bound and heap and (-gain, row) > heap[0]:
            heappush(heap, (-gain, row))
            continue
        order.append(row)
        covered[keys[row]] = True
    return np.array(order, dtype=np.int64)
