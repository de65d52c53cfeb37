"""Covering arrays: few feasible rows that contain every feasible combination of categories of any t variables."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from itertools import combinations
from math import comb, prod

import numpy as np

from pipeline.core.constraints import Bools, Constraints
from pipeline.core.coverage.annealing import Int32s
from pipeline.core.coverage.constructions import FREE, cyclic, factorial, orthogonal
from pipeline.core.coverage.mixed import STRONGEST, Mixed, NamedPlanes, all_planes, copy_for
from pipeline.core.coverage.problem import Problem, feasible_row, lay_out
from pipeline.core.space import Ints

Progress = Callable[[float, int, int], None]
"""Called with the share done (of the cells; when polishing, of the time), the current size and the lower bound."""
CANDIDATES = 16
SWEEPS = 5
QUICK_OPERATIONS = 3e8
"""Elementary annealing steps for a quick array: a fixed number, so the same seed gives the same rows on any machine."""
ATTEMPT_OPERATIONS = 1.2e8
OPERATIONS_A_SECOND = 6e8
"""A slow machine's approximate value, until it is measured."""
TEMPERATURES = ((0.55, 0.13), (0.35, 0.18), (0.3, 0.08))
"""First and last temperature of an attempt. The last keeps a regular construction intact, which may still save one row."""
FRESH_LONGER, FRESH_TEMPERATURES = 2.5, (0.26, 0.2)
"""Temperatures of attempts that start from a full factorial: they need a long time at a nearly constant temperature."""
LONGEST = 15
"""Longest attempt, as a multiple of the first."""


@dataclass(frozen=True)
class Effort:
    """How long to search for a small array.

    polish_s: seconds of search, positive, unless the lower bound is reached earlier; None for a fixed number of steps, so the array depends
    on the other arguments alone.
    """

    polish_s: float | None = None
    progress: Progress | None = None

    def __post_init__(self) -> None:
        if self.polish_s is not None and not self.polish_s > 0:
            raise ValueError(f"polish_s must be positive, got {self.polish_s}")


QUICK = Effort()


@dataclass(frozen=True)
class CoveringArray:
    """rows: (n, d) category indices. cells: number of feasible cells that are wanted, all covered. lower_bound: no array has fewer rows."""

    rows: Ints
    strength: int
    cells: int
    lower_bound: int

    @property
    def size(self) -> int:
        return len(self.rows)


def covering_array(
    constraints: Constraints, strength: int | Mixed = 2, *, seeds: Ints | None = None, seed: int = 0, effort: Effort = QUICK
) -> CoveringArray:
    """A covering array over the variables of `constraints`.

    strength: t, 1 to 6, alone or with more planes. seeds: (m, d) rows that the array starts with.

    Raises ValueError for contradictory constraints, an infeasible seed row and a strength out of range.
    """
    sizes, mixed = constraints.sizes, Mixed(strength) if isinstance(strength, int) else strength
    if not 1 <= mixed.strength <= min(STRONGEST, len(sizes)):
        raise ValueError(f"strength must be in [1, {min(STRONGEST, len(sizes))}], got {mixed.strength}")
    planes = all_planes(len(sizes), mixed)
    limits = copy_for(constraints, planes)
    if not limits.satisfiable({}):
        raise ValueError(f"clauses {', '.join(map(str, limits.contradiction()))} contradict each other: no row is feasible")
    given = np.zeros((0, len(sizes)), np.int32) if seeds is None else np.asarray(seeds, np.int32)
    if (given < 0).any():
        raise ValueError("seed rows need a category of each variable")
    given = np.pad(given, ((0, 0), (0, len(limits.sizes) - len(sizes))))
    if broken := limits.first_broken(given.astype(np.int64)):
        raise ValueError(f"seed row {broken[0]} breaks clause {broken[1]}")
    started = time.monotonic()
    bound = max([lower_bound(sizes, mixed.strength, limits), *(_bound_of(named, limits) for named in mixed.extras.planes)])

    def covering(share: float, size: int) -> None:
        if effort.progress is not None:
            effort.progress(share if effort.polish_s is None else 0.0, size, bound)

    search = _Search(lay_out(limits, planes), limits, given, np.random.default_rng(seed), covering)
    # Besides the seed rows, the array needs a row for each uncovered cell of the emptiest plane.
    left = np.add.reduceat(search.problem.counts(given) == 0, search.problem.first, dtype=np.int64)
    bound = max(bound, len(given) + int(left.max()))
    rows = search.start()
    if effort.polish_s is None:
        rows = search.shorten(rows, bound, operations=QUICK_OPERATIONS)
    else:
        rows = search.polish(rows, bound, started, effort.polish_s, effort.progress)
    rows = rows[:, : len(sizes)]
    return CoveringArray(rows.astype(np.int64), mixed.strength, int(search.problem.required.sum()), min(bound, len(rows)))


def _bound_of(named: NamedPlanes, constraints: Constraints) -> int:
    """A lower bound of the rows that named planes need; 0 with constraints, where the emptiest plane decides."""
    return 0 if constraints.clauses else lower_bound([constraints.sizes[v] for v in named.variables], named.strength)


def lower_bound(sizes: Sequence[int], strength: int, constraints: Constraints | None = None) -> int:
    """A lower bound of the rows of a covering array.

    A row covers one cell of each plane, so the plane with the most feasible cells is a bound. Without constraints there are two more:
    binary columns need as many rows as Kleitman and Spencer's theorem says (1973), and the rows that share a category of one column cover
    all other columns with strength t - 1.
    """
    if constraints is not None and constraints.clauses:
        largest = sorted(combinations(range(len(sizes)), strength), key=lambda plane: -prod(sizes[c] for c in plane))
        best = 0
        for plane in largest:
            if prod(sizes[c] for c in plane) <= best:
                break
            best = max(best, int(constraints.feasible_cells(plane).sum()))
        return best
    ordered = sorted(sizes, reverse=True)
    if strength == 1:
        return ordered[0]
    bound = prod(ordered[:strength])
    if strength == 2:
        return max(bound, _binary_bound(sum(size >= 2 for size in sizes)))
    return max(bound, ordered[0] * lower_bound(ordered[1:], strength - 1))


def _binary_bound(columns: int) -> int:
    """Fewest rows of a pair-wise array of binary columns: the smallest N with C(N - 1, ceil(N / 2)) >= columns."""
    rows = 1
    while comb(rows - 1, -(-rows // 2)) < columns:
        rows += 1
    return rows if columns > 1 else 2 * columns


class _Search:
    """The search for a small array: starts, and shortening by annealing."""

    def __init__(
        self, problem: Problem, constraints: Constraints, given: Int32s, rng: np.random.Generator, covering: Callable[[float, int], None]
    ) -> None:
        """covering: called with the share of covered cells and the current number of rows."""
        self.problem, self._constraints, self._given, self._rng, self._covering = problem, constraints, given, rng, covering
        self._nothing_held = np.zeros(len(problem.sizes), np.bool_)

    def start(self) -> Int32s:
        """The smallest array from greedy search and known constructions."""
        found = [self.complete(self._given)]
        if self.problem.strength == 2 and not self._constraints.clauses and not len(self._given):
            sizes = tuple(int(size) for size in self.problem.sizes)
            size = len(found[0])
            starts = (factorial(sizes), orthogonal(sizes), cyclic(sizes, size, int(self._rng.integers(2**31))))
            found += [self.complete(rows) for rows in starts if rows is not None]
        return min(found, key=len)

    def complete(self, start: Int32s) -> Int32s:
        """Fill the free cells of the start rows greedily, then add rows until every cell is covered."""
        problem, counts = self.problem, self.problem.counts(np.zeros((0, len(self.problem.sizes)), np.int32))
        rows = []
        for row in start:
            held = row != FREE
            full = row.copy() if held.all() else self._ascend(np.array([self._any_row(row) for _ in range(2)]), counts, held)
            problem.count(full[None], counts)
            rows.append(full)
        while len(uncovered := np.flatnonzero(counts == 0)):
            self._covering(1 - len(uncovered) / len(counts), len(rows))
            chosen = uncovered[self._rng.integers(len(uncovered), size=CANDIDATES)]
            full = self._ascend(np.array([self._row_with(int(cell)) for cell in chosen]), counts, self._nothing_held)
            problem.count(full[None], counts)
            rows.append(full)
        return np.array(rows, np.int32).reshape(-1, len(problem.sizes))

    def _ascend(self, starts: Int32s, counts: Int32s, held: Bools) -> Int32s:
        return self.problem.best_row(starts, (counts == 0).astype(np.int32), held, SWEEPS, int(self._rng.integers(2**31)))

    def _any_row(self, row: Int32s) -> Int32s:
        return np.where(row == FREE, self._rng.integers(0, self.problem.sizes), row).astype(np.int32)

    def _row_with(self, cell: int) -> Int32s:
        """A random feasible row in a cell."""
        columns, categories = self.problem.cell(cell)
        return feasible_row(self._constraints, columns, categories, self._rng)

    def shorten(self, rows: Int32s, bound: int, operations: float) -> Int32s:
        """Remove rows, several at a time while that succeeds, until the steps are spent."""
        away, fails = max(1, len(rows) // 12), 0
        while operations > 0 and len(rows) > max(bound, len(self._given)):
            spent = min(operations, ATTEMPT_OPERATIONS * 0.4)
            operations -= spent
            shorter = self._without(rows, min(away, len(rows) - max(bound, len(self._given))), spent, TEMPERATURES[fails % 2])
            if shorter is not None:
                rows = shorter
            else:
                away, fails = max(1, away // 2), fails + 1
        return rows

    def polish(self, rows: Int32s, bound: int, started: float, seconds: float, progress: Progress | None) -> Int32s:
        """Remove rows until the time is spent or the bound is reached.

        A failed attempt makes the next one longer and changes its temperatures: which ones work depends on the problem, so temperatures
        that succeeded are kept.
        """
        fails, way, away, bound = 0, 0, max(1, len(rows) // 12), max(bound, len(self._given))
        # Near the product of the two largest sizes a regular start gets further than the greedy array.
        fresh = self.problem.strength == 2 and not self._constraints.clauses and not len(self._given) and len(rows) < 1.15 * bound
        speed = OPERATIONS_A_SECOND
        while (spent := time.monotonic() - started) < seconds and len(rows) > bound:
            if progress is not None:
                progress(spent / seconds, len(rows), bound)
            again = fresh and fails % 4 == 3
            operations = min(ATTEMPT_OPERATIONS * (1 + fails) * (FRESH_LONGER if again else 1), speed * (seconds - spent))
            begun = time.monotonic()
            if again:
                shorter = self._annealed(self._balanced(len(rows) - 1), operations, FRESH_TEMPERATURES)
            else:
                shorter = self._without(rows, min(away, len(rows) - bound), operations, TEMPERATURES[way])
            if shorter is not None:
                rows, fails = shorter, 0
                continue
            speed = operations / max(1e-3, time.monotonic() - begun)  # A failed attempt used up all its steps.
            way = (way + (not again)) % len(TEMPERATURES)
            if away > 1:
                away = max(1, away // 2)
            else:
                fails = fails + 1 if fails < LONGEST else LONGEST - 1
        return rows

    def _without(self, rows: Int32s, away: int, operations: float, temperatures: tuple[float, float]) -> Int32s | None:
        """An array with `away` rows fewer; None if annealing does not find one."""
        given = len(self._given)
        unique = self.problem.unique_cells(rows)
        order = np.argsort(unique[given:] + self._rng.random(len(rows) - given), kind="stable") + given
        kept = np.ascontiguousarray(np.delete(rows, order[:away], axis=0))
        return self._annealed(kept, operations, temperatures) if len(kept) > given else None

    def _annealed(self, rows: Int32s, operations: float, temperatures: tuple[float, float]) -> Int32s | None:
        """The rows, changed until they cover every cell; None if that fails."""
        problem = self.problem
        step = 3.0 * problem.grid.lines.base.shape[1] * problem.strength + 0.2 * len(rows) * (problem.strength + problem.literals_a_column)
        seed, iterations = int(self._rng.integers(2**31)), max(1000, int(operations / step))
        left = problem.anneal(rows[len(self._given) :], problem.counts(rows), iterations, temperatures, seed)
        return rows if left == 0 else None

    def _balanced(self, count: int) -> Int32s:
        """Rows to anneal: the two largest columns as a full factorial, the other columns with every category equally often."""
        sizes = self.problem.sizes
        first, second, *others = np.argsort(-sizes, kind="stable").tolist()
        pairs = int(sizes[first] * sizes[second])
        rows = self._rng.integers(0, sizes, size=(count, len(sizes))).astype(np.int32)
        rows[:pairs, first], rows[:pairs, second] = np.divmod(np.arange(pairs), sizes[second])
        for column in others:
            for category in range(sizes[first]):
                at = np.flatnonzero(rows[:pairs, first] == category)
                rows[at, column] = self._rng.permutation(np.resize(self._rng.permutation(sizes[column]), len(at)))
        return rows


def order_by_new_pairs(rows: Ints) -> Ints:
    """Order of (n, d) rows, as (n,) indices: each next row covers the most new pairs, so prefixes cover the most."""
    keys = _pair_keys(rows)
    covered = np.zeros(int(keys.max(initial=-1)) + 1, dtype=bool)
    # Gains only fall as pairs get covered, so a stale gain is an upper bound: only the head of the heap is recounted.
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


def _pair_keys(rows: Ints) -> Ints:
    """(n, d) rows to (n, d (d - 1) / 2) numbers, one for each pair of categories."""
    pairs = list(combinations(range(rows.shape[1]), 2))
    keys = np.zeros((len(rows), len(pairs)), dtype=np.int64)
    if not len(rows):
        return keys
    sizes, offset = rows.max(axis=0) + 1, 0
    for position, (first, second) in enumerate(pairs):
        keys[:, position] = offset + rows[:, first] * sizes[second] + rows[:, second]
        offset += sizes[first] * sizes[second]
    return keys
