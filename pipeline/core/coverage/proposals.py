"""Proposals: feasible points that raise k-projection coverage most, or that complete it.

Source: Cheng et al., Definition 5, Algorithms 1 and 2.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipeline.core.coverage.arrays import covering_array
from pipeline.core.coverage.completion import Completion, Task, bound_of_part, whole_programme
from pipeline.core.coverage.grid import Int32s
from pipeline.core.coverage.mixed import STRONGEST, all_planes, copy_for
from pipeline.core.coverage.optimum import best_points
from pipeline.core.coverage.problem import INFEASIBLE, feasible_rows, lay_out
from pipeline.core.coverage.projection import Demand, check_points
from pipeline.core.variable import Ints

STARTS, SWEEPS = 64, 10
ANNEALING_STEPS, TEMPERATURES = 400_000, (0.5, 0.05)
TIME_LIMIT_S = 20.0


@dataclass(frozen=True)
class Proposal:
    """Points to add.

    Attributes:
        categories: (b, d) category indices.
        gain: increase of the coverage's numerator; with heavy_first, the weight of the filled
            cells.
        bound: upper bound of the gain of any b points.
    """

    categories: Ints
    gain: int
    bound: int

    @property
    def optimal(self) -> bool:
        """Whether no b points gain more."""
        return self.gain == self.bound


class Proposer:
    """Proposes points that meet a demand; set up once, used any number of times.

    Args:
        demand: what full coverage needs.
        heavy_first: count the weight of a cell that still wants points instead of 1, so that
            heavy classes come first if full coverage is out of reach (the paper's first
            extension).
        seed: seed of all random draws, from 0.

    >>> from pipeline.core.constraints import Constraints
    >>> proposer = Proposer(Demand(Constraints((2, 2)), k=2))
    >>> proposal = proposer.propose(np.array([[0, 0], [0, 1], [1, 0]]))
    >>> proposal.categories.tolist(), proposal.gain, proposal.optimal
    ([[1, 1]], 1, True)
    >>> len(proposer.completion(np.zeros((0, 2), int)).categories)
    4
    """

    def __init__(self, demand: Demand, *, heavy_first: bool = False, seed: int = 0) -> None:
        planes = all_planes(len(demand.sizes), demand.mixed)
        self._demand, self._constraints = demand, copy_for(demand.constraints, planes)
        self._problem = lay_out(self._constraints, planes)
        weights = np.concatenate([cells.ravel() for cells in demand.weights_of(planes)])
        self._wanted = self._problem.required * self._with_filler(weights)
        self._heavy_first, self._rng = heavy_first, np.random.default_rng(seed)

    def missing(self, points: Ints) -> Ints:
        """Number of points that each cell still wants, (cells,), beside (n, d) points."""
        counts = self._demand.counts()
        counts.add(points)
        return np.asarray(np.maximum(0, self._wanted - self._with_filler(counts.flat)), np.int64)

    def _with_filler(self, cells: Ints) -> Ints:
        """Numbers of the demand's cells, and 0 for the plane that fills up the problem, if any."""
        return np.pad(cells, (0, len(self._problem.required) - len(cells)))

    def _points(self, rows: ArrayLike) -> Ints:
        """Rows of the problem without the column that fills up smaller planes, if any."""
        return np.asarray(rows, np.int64)[:, : len(self._demand.sizes)]

    def propose(self, points: Ints, count: int = 1) -> Proposal | None:
        """Propose points by coordinate ascent from many starts, then improve them together.

        Takes milliseconds. The gain is rarely below the optimum; `Proposal.bound` limits by how
        much.

        Args:
            points: (n, d) category indices of the existing points, -1 for unknown; n may be 0.
            count: number of points to propose, at least 1.

        Returns:
            Up to `count` points, fewer if they complete the coverage; None if nothing is missing.

        Raises:
            ValueError: if a point is infeasible or an index is out of range.
        """
        check_points(points, self._demand.constraints)
        missing = self.missing(points)
        return self._proposed(missing, count) if missing.any() else None

    def _proposed(self, missing: Ints, count: int) -> Proposal:
        bound = self._bound(missing, count)
        rows = np.zeros((0, len(self._problem.sizes)), np.int32)
        for _ in range(count):
            left = self._after(missing, rows)
            if not left.any():
                break
            rows = np.vstack([rows, self._best(left)])
        gain = self._gain(missing, rows)
        if len(rows) > 1 and gain < bound and self._wanted.max() == 1:
            changed = self._changed_together(missing, rows)
            if (other := self._gain(missing, changed)) > gain:
                rows, gain = changed, other
        return Proposal(self._points(rows), gain, bound)

    def propose_exact(
        self, points: Ints, count: int = 1, time_limit_s: float = TIME_LIMIT_S
    ) -> Proposal | None:
        """Propose points together by 0-1 programming with HiGHS.

        Args:
            points: as in `propose`.
            count: as in `propose`.
            time_limit_s: seconds, > 0.

        Returns:
            The optimum; at the time limit, the best solution so far and a bound. None if nothing
            is missing.

        Raises:
            ValueError: if a point is infeasible or an index is out of range.
        """
        check_points(points, self._demand.constraints)
        missing = self.missing(points)
        if not missing.any():
            return None
        quick = self._proposed(missing, count)
        if quick.optimal:
            return quick
        rows, bound = best_points(
            self._problem, self._constraints, (missing, self._worth(missing)), count, time_limit_s
        )
        best = min(quick.bound, bound)
        if rows is not None and (gain := self._gain(missing, rows)) > quick.gain:
            return Proposal(self._points(rows), gain, max(gain, best))
        return Proposal(quick.categories, quick.gain, max(quick.gain, best))

    def complete(self, points: Ints, exact: bool = False) -> Iterator[Proposal]:
        """Yield proposals of one point each until nothing is missing.

        Args:
            points: as in `propose`; each proposal also takes the proposals before it into account.
            exact: propose by 0-1 programming.
        """
        propose = self.propose_exact if exact else self.propose
        while (proposal := propose(points)) is not None:
            yield proposal
            points = np.vstack([points, proposal.categories])

    def fewest(self, points: Ints) -> int:
        """Lower bound of the number of points that full coverage still needs.

        A point lies in one cell of each plane, so the emptiest plane decides.
        """
        return int(np.add.reduceat(self.missing(points), self._problem.first).max())

    def completion(self, points: Ints) -> Completion:
        """Complete the coverage with few points: the fewest, with a proof, in a small domain.

        Without constraints they are always the fewest for k = 1, because conditions are
        independent (Algorithm 1, Proposition 6).

        Args:
            points: as in `propose`.

        Raises:
            ValueError: if a point is infeasible or an index is out of range.
        """
        check_points(points, self._demand.constraints)
        missing = self.missing(points)
        if self._demand.k == 1 and not self._demand.extras and not self._constraints.clauses:
            # Each condition lists the categories that it wants, padded with its first category.
            lists = np.split(missing, self._problem.first[1:])
            rows = np.zeros((max(int(wanted.sum()) for wanted in lists), len(lists)), np.int64)
            for condition, wanted in enumerate(lists):
                rows[: int(wanted.sum()), condition] = np.repeat(np.arange(len(wanted)), wanted)
            return Completion(rows, len(rows))
        task = Task(self._constraints, self._problem, missing)
        programme = whole_programme(task)
        if programme is None:
            quick = self._quick_completion(points)
            bound = bound_of_part(task, quick.bound, len(quick.categories))
            return Completion(quick.categories, bound)
        single = self._one_by_one(points)
        fewer, bound = programme.solve(single.bound, len(single.categories) - 1)
        categories = single.categories if fewer is None else self._points(fewer)
        best = Completion(categories, bound)
        return best if best.smallest else best.better(self._quick_completion(points))

    def _quick_completion(self, points: Ints) -> Completion:
        """The rows of a covering array, where a completion is one; else points one by one."""
        if (
            self._problem.strength > STRONGEST
            or self._wanted.max() > 1
            or not self._wanted[self._problem.required].all()
            or (points < 0).any()
        ):
            return self._one_by_one(points)
        array = covering_array(
            self._demand.constraints,
            self._demand.mixed,
            seeds=points,
            seed=int(self._rng.integers(2**31)),
        )
        return Completion(array.rows[len(points) :], array.lower_bound - len(points))

    def _one_by_one(self, points: Ints) -> Completion:
        rows = [proposal.categories for proposal in self.complete(points)]
        return Completion(np.vstack([points[:0], *rows]), self.fewest(points))

    def _worth(self, missing: Ints) -> Ints:
        return np.where(missing > 0, self._wanted if self._heavy_first else 1, 0)

    def _best(self, missing: Ints) -> Int32s:
        """The best single row of several coordinate ascents."""
        cells = np.flatnonzero(missing)
        cells = cells[self._rng.integers(len(cells), size=STARTS)]
        starts = feasible_rows(self._problem, self._constraints, cells, self._rng)
        held = np.zeros(len(self._problem.sizes), np.bool_)
        worth, seed = self._worth(missing), int(self._rng.integers(2**31))
        return self._problem.best_row(starts, worth, held, SWEEPS, seed)

    def _changed_together(self, missing: Ints, rows: Int32s) -> Int32s:
        """The rows after annealing, which covers more of the missing cells if it can."""
        problem, changed = self._problem, rows.copy()
        # Cells that are already covered may be left and entered freely.
        counts = np.where(missing > 0, np.int32(0), INFEASIBLE)
        problem.count(changed, counts)
        seed = int(self._rng.integers(2**31))
        problem.anneal(changed, counts, ANNEALING_STEPS, TEMPERATURES, seed)
        return changed

    def _after(self, missing: Ints, rows: Int32s) -> Ints:
        """What is still missing after the rows are added."""
        problem, counts = self._problem, np.zeros(len(missing), np.int32)
        problem.count(rows, counts)
        return np.asarray(np.maximum(0, missing - counts), np.int64)

    def _gain(self, missing: Ints, rows: Int32s) -> int:
        return int(((missing - self._after(missing, rows)) * self._worth(missing)).sum())

    def _bound(self, missing: Ints, count: int) -> int:
        """Upper bound of the gain of `count` points.

        A point lies in one cell of each plane, so it gains at most the worth of the best cell, and
        all points together no more than is missing.
        """
        # A heavy cell may be worth the square of its weight, which only Python's integers hold.
        worth = self._worth(missing).astype(object if self._heavy_first else np.int64)
        first = self._problem.first
        best = count * np.maximum.reduceat(worth, first)
        return int(np.minimum(best, np.add.reduceat(missing * worth, first)).sum())
