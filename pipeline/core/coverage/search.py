"""The search for a small covering array: starts, and shortening by annealing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.core.constraints import Bools, Constraints
from pipeline.core.coverage.bounds import lower_bound
from pipeline.core.coverage.constructions import FREE, cyclic, doubled, factorial, orthogonal
from pipeline.core.coverage.grid import Int32s
from pipeline.core.coverage.hash_families import from_hash_family
from pipeline.core.coverage.problem import Problem, feasible_rows, of_strength
from pipeline.core.coverage.symmetric import SymmetricSearch

CANDIDATES = 16
SWEEPS = 5
ATTEMPT_OPERATIONS = 1.2e8
OPERATIONS_A_SECOND = 6e8
"""A slow machine's approximate value, until it is measured."""
TEMPERATURES = ((0.55, 0.13), (0.35, 0.18), (0.3, 0.08))
"""First and last temperature of an attempt. The last pair keeps a regular construction intact,
which may still save one row."""
FRESH_LONGER, FRESH_TEMPERATURES = 2.5, (0.26, 0.2)
"""Attempts that start from a full factorial need a long time at a nearly constant temperature."""
LONGEST = 15
"""Longest attempt, as a multiple of the first."""
SYMMETRIC_SHARE = 0.7
"""Share of the time for symmetric arrays, where they apply."""
SMALLEST_DOUBLED = 8
"""Fewest columns for which halves of an array of strength 3 are put together."""
HALF_OPERATIONS = 1.5e8
SHRUNK = 0.97
"""What annealing leaves of a greedy array, at most; it hardly shrinks one from a hash family."""


@dataclass(frozen=True)
class Limit:
    """When to stop.

    seconds: time limit, > 0.
    spent: seconds since the start, by the clock that counts.
    tell: called with the current number of rows.
    """

    seconds: float
    spent: Callable[[], float]
    tell: Callable[[int], None]


class Search:
    """The search for a small array: starts, and shortening by annealing.

    Args:
        problem: the cells to cover.
        constraints: of the problem's columns.
        given: (m, n) rows that the array starts with.
        rng: source of all random draws.
        covering: called with the share of covered cells and the current number of rows.
    """

    def __init__(
        self,
        problem: Problem,
        constraints: Constraints,
        given: Int32s,
        rng: np.random.Generator,
        covering: Callable[[float, int], None],
    ) -> None:
        self.problem, self._constraints, self._given = problem, constraints, given
        self._rng, self._covering = rng, covering

    @property
    def free(self) -> bool:
        """Whether constructions apply: all cells are wanted, without constraints or given rows."""
        return (
            not self._constraints.clauses
            and not len(self._given)
            and bool(self.problem.required.all())
        )

    def start(self, go_on: Callable[[], bool] = lambda: True) -> Int32s:
        """The smallest array from greedy search and known constructions, (rows, n).

        go_on: whether there is time for another construction.
        """
        best = self.complete(self._given)
        if not self.free or self.problem.strength == 1:
            return best
        sizes, strength, size = tuple(self.problem.sizes.tolist()), self.problem.strength, len(best)
        seed = int(self._rng.integers(2**31))
        starts: list[Callable[[], Int32s | None]] = [lambda: orthogonal(sizes, strength, 2 * size)]
        if strength == 2:
            starts += [lambda: factorial(sizes), lambda: cyclic(sizes, size, seed)]
        else:
            starts.append(lambda: from_hash_family(sizes, strength, int(SHRUNK * size), seed))
        for construct in starts:
            if go_on() and (rows := construct()) is not None:
                best = min(best, self.complete(rows), key=len)
        return best

    def structured(self, rows: Int32s, bound: int, limit: Limit) -> Int32s:
        """A smaller array from doubling or symmetry, if the time suffices; else the rows."""
        sizes, strength = tuple(self.problem.sizes.tolist()), self.problem.strength
        if not self.free:
            return rows
        if strength == 3 and len(sizes) >= SMALLEST_DOUBLED:
            rows = min(rows, self._doubled(limit), key=len)
        if SymmetricSearch.suits(sizes, strength):
            search = SymmetricSearch(sizes, strength, self._rng)

            def go_on() -> bool:
                limit.tell(len(rows))
                return limit.spent() < SYMMETRIC_SHARE * limit.seconds

            while len(rows) > bound and (smaller := search.smaller(len(rows), go_on)) is not None:
                rows = min(rows, self.complete(smaller), key=len)
        return rows

    def _doubled(self, limit: Limit) -> Int32s:
        """An array of strength 3 from quick arrays of strengths 3 and 2 for half of the columns."""
        order = np.argsort(-self.problem.sizes, kind="stable")
        sizes = tuple(self.problem.sizes[order].tolist())
        half = Constraints(sizes[: (len(sizes) + 1) // 2])
        nothing = np.zeros((0, len(half.sizes)), np.int32)
        operations = min(HALF_OPERATIONS, OPERATIONS_A_SECOND * limit.seconds / 8)
        arrays = []
        for strength in (3, 2):
            smaller = of_strength(half, strength)
            search = Search(smaller, half, nothing, self._rng, lambda share, size: None)
            bound = lower_bound(half.sizes, strength)
            arrays.append(search.shorten(search.start(), bound, operations))
        three, two = arrays
        rows = np.empty((len(three) + (sizes[0] - 1) * len(two), len(sizes)), np.int32)
        rows[:, order] = doubled(three, two, sizes)
        return self.complete(rows)

    def complete(self, start: Int32s) -> Int32s:
        """Fill the free cells of (m, n) start rows greedily, then add rows until all is covered."""
        problem, rows = self.problem, []
        counts = problem.counts(np.zeros((0, len(problem.sizes)), np.int32))
        for row in start:
            held, full = row != FREE, row.copy()
            if not held.all():
                draws = self._rng.integers(0, problem.sizes, (2, len(row)))
                full = self._ascend(np.where(held, row, draws).astype(np.int32), counts, held)
            problem.count(full[None], counts)
            rows.append(full)
        nothing_held = np.zeros(len(problem.sizes), np.bool_)
        while len(uncovered := np.flatnonzero(counts == 0)):
            self._covering(1 - len(uncovered) / len(counts), len(rows))
            cells = uncovered[self._rng.integers(len(uncovered), size=CANDIDATES)]
            starts = feasible_rows(problem, self._constraints, cells, self._rng)
            full = self._ascend(starts, counts, nothing_held)
            problem.count(full[None], counts)
            rows.append(full)
        return np.array(rows, np.int32).reshape(-1, len(problem.sizes))

    def _ascend(self, starts: Int32s, counts: Int32s, held: Bools) -> Int32s:
        uncovered, seed = (counts == 0).astype(np.int32), int(self._rng.integers(2**31))
        return self.problem.best_row(starts, uncovered, held, SWEEPS, seed)

    def shorten(self, rows: Int32s, bound: int, operations: float) -> Int32s:
        """Remove rows, several at a time while that succeeds, until the steps are spent."""
        away, fails, bound = max(1, len(rows) // 12), 0, max(bound, len(self._given))
        while operations > 0 and len(rows) > bound:
            spent = min(operations, ATTEMPT_OPERATIONS * 0.4)
            operations -= spent
            temperatures = TEMPERATURES[fails % 2]
            shorter = self._without(rows, min(away, len(rows) - bound), spent, temperatures)
            if shorter is not None:
                rows = shorter
            else:
                away, fails = max(1, away // 2), fails + 1
        return rows

    def polish(self, rows: Int32s, bound: int, limit: Limit) -> Int32s:
        """Remove rows until the time is spent or the bound is reached.

        A failed attempt makes the next one longer and changes its temperatures. Which ones work
        depends on the problem, so temperatures that succeeded are kept.
        """
        rows = self.structured(rows, bound, limit)
        fails, way, away, bound = 0, 0, max(1, len(rows) // 12), max(bound, len(self._given))
        # Near the product of the two largest sizes a regular start gets further than a greedy one.
        fresh = self.problem.strength == 2 and self.free and len(rows) < 1.15 * bound
        speed = OPERATIONS_A_SECOND
        while (left := limit.seconds - limit.spent()) > 0 and len(rows) > bound:
            limit.tell(len(rows))
            again = fresh and fails % 4 == 3
            longer = FRESH_LONGER if again else 1
            operations = min(ATTEMPT_OPERATIONS * (1 + fails) * longer, speed * left)
            begun = limit.spent()
            if again:
                balanced = self._balanced(len(rows) - 1)
                shorter = self._annealed(balanced, operations, FRESH_TEMPERATURES)
            else:
                fewer = min(away, len(rows) - bound)
                shorter = self._without(rows, fewer, operations, TEMPERATURES[way])
            if shorter is not None:
                rows, fails = shorter, 0
                continue
            # A failed attempt used up all its steps.
            speed = operations / max(1e-3, limit.spent() - begun)
            way = (way + (not again)) % len(TEMPERATURES)
            if away > 1:
                away = max(1, away // 2)
            else:
                fails = fails + 1 if fails < LONGEST else LONGEST - 1
        return rows

    def _without(
        self, rows: Int32s, away: int, operations: float, temperatures: tuple[float, float]
    ) -> Int32s | None:
        """An array with `away` rows fewer; None if annealing does not reach one."""
        given = len(self._given)
        unique = self.problem.unique_cells(rows)
        rank = unique[given:] + self._rng.random(len(rows) - given)
        order = np.argsort(rank, kind="stable") + given
        kept = np.ascontiguousarray(np.delete(rows, order[:away], axis=0))
        return self._annealed(kept, operations, temperatures) if len(kept) > given else None

    def _annealed(
        self, rows: Int32s, operations: float, temperatures: tuple[float, float]
    ) -> Int32s | None:
        """The rows, changed until they cover every cell; None if that fails."""
        problem = self.problem
        step = 3.0 * problem.grid.lines.base.shape[1] * problem.strength + 0.2 * len(rows) * (
            problem.strength + problem.literals_a_column
        )
        seed, iterations = int(self._rng.integers(2**31)), max(1000, int(operations / step))
        free, counts = rows[len(self._given) :], problem.counts(rows)
        left = problem.anneal(free, counts, iterations, temperatures, seed)
        return rows if left == 0 else None

    def _balanced(self, count: int) -> Int32s:
        """Rows to anneal: the two largest columns as a full factorial, others balanced.

        Balanced: every category equally often beside each category of the largest column.
        """
        sizes = self.problem.sizes
        first, second, *others = np.argsort(-sizes, kind="stable").tolist()
        pairs = int(sizes[first] * sizes[second])
        rows = self._rng.integers(0, sizes, size=(count, len(sizes))).astype(np.int32)
        rows[:pairs, first], rows[:pairs, second] = np.divmod(np.arange(pairs), sizes[second])
        for column in others:
            for category in range(sizes[first]):
                at = np.flatnonzero(rows[:pairs, first] == category)
                repeated = np.resize(self._rng.permutation(sizes[column]), len(at))
                rows[at, column] = self._rng.permutation(repeated)
        return rows
