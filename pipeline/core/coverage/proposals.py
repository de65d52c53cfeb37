"""Proposals: the feasible points that raise k-projection coverage most or complete it (Cheng et al., Definition 5, Algorithms 1 and 2)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from pipeline.core.constraints import Constraints
from pipeline.core.coverage.arrays import covering_array
from pipeline.core.coverage.completion import Completion, Task, bound_of_part, whole_programme
from pipeline.core.coverage.grid import Int32s
from pipeline.core.coverage.mixed import STRONGEST, all_planes, copy_for
from pipeline.core.coverage.problem import INFEASIBLE, feasible_row, lay_out
from pipeline.core.coverage.projection import Demand, check_points
from pipeline.core.variable import Ints

STARTS, SWEEPS = 64, 10
ANNEALING_STEPS, TEMPERATURES = 400_000, (0.5, 0.05)
TIME_LIMIT_S = 20.0


@dataclass(frozen=True)
class Proposal:
    """Points to add. categories: (b, d) indices. gain: increase of coverage's numerator; with heavy_first, the weight of the filled
    cells; bound: upper bound of the gain."""

    categories: Ints
    gain: int
    bound: int

    @property
    def optimal(self) -> bool:
        return self.gain == self.bound


class Proposer:
    """Proposes points that meet a demand; set up once, used any number of times.

    heavy_first: a cell that still wants points counts its weight, not 1, so that heavy classes come first if full coverage is out of reach
    (the paper's first extension).
    """

    def __init__(self, demand: Demand, *, heavy_first: bool = False, seed: int = 0) -> None:
        planes = all_planes(len(demand.sizes), demand.mixed)
        self._demand, self._constraints = demand, copy_for(demand.constraints, planes)
        self._problem = lay_out(self._constraints, planes)
        self._wanted = self._problem.required * self._filled_up(
            np.concatenate([cells.ravel() for cells in demand.weights_of(planes)])
        )
        self._heavy_first, self._rng = heavy_first, np.random.default_rng(seed)

    def missing(self, points: Ints) -> Ints:
        """Number of points that each cell still wants, (cells,)."""
        counts = self._demand.counts()
        counts.add(points)
        return np.asarray(np.maximum(0, self._wanted - self._filled_up(counts.flat)), np.int64)

    def _filled_up(self, cells: Ints) -> Ints:
        """Numbers of the cells of the demand, and of the plane that fills up the problem, if it has one."""
        return np.pad(cells, (0, len(self._problem.required) - len(cells)))

    def _points(self, rows: ArrayLike) -> Ints:
        """Rows of the problem without the column that fills it up, if it has one."""
        return np.asarray(rows, np.int64)[:, : len(self._demand.sizes)]

    def propose(self, points: Ints, count: int = 1) -> Proposal | None:
        """Propose `count` points by coordinate ascent from many starts, one after the other, then improved together; None if nothing is
        missing.

        points: (n, d) existing points, n may be 0. Takes milliseconds; `gain` is rarely below the optimum, `bound` limits by how much.
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
        """Propose `count` points together by 0-1 programming with HiGHS: the optimum, or at the time limit the best solution and a
        bound."""
        check_points(points, self._demand.constraints)
        missing = self.missing(points)
        if not missing.any():
            return None
        quick = self._proposed(missing, count)
        if quick.optimal:
            return quick
        found, bound = _solve(self._wanting(missing), self._constraints, count, time_limit_s)
        best = min(quick.bound, bound)
        if found is not None and (gain := self._gain(missing, found)) > quick.gain:
            return Proposal(self._points(found), gain, max(gain, best))
        return Proposal(quick.categories, quick.gain, max(quick.gain, best))

    def complete(self, points: Ints, exact: bool = False) -> Iterator[Proposal]:
        """Proposals of one point each, given the points before it, until nothing is missing."""
        while (
            proposal := self.propose_exact(points) if exact else self.propose(points)
        ) is not None:
            yield proposal
            points = np.vstack([points, proposal.categories])

    def fewest(self, points: Ints) -> int:
        """Lower bound of the points that full coverage still needs: a point lies in one cell of each plane, so the emptiest plane
        decides."""
        return int(np.add.reduceat(self.missing(points), self._problem.first).max())

    def completion(self, points: Ints) -> Completion:
        """Complete the coverage with few points: the fewest, with a proof, if the domain is small enough.

        Without constraints they are always the fewest for k = 1, because conditions are independent (Algorithm 1, Proposition 6).
        """
        check_points(points, self._demand.constraints)
        missing = self.missing(points)
        if self._demand.k == 1 and not self._demand.extras and not self._constraints.clauses:
            rows = self._each_condition_alone(missing)
            return Completion(rows, len(rows))
        task = Task(self._constraints, self._problem, missing)
        programme = whole_programme(task)
        if programme is None:
            found = self._quick_completion(points)
            return Completion(
                found.categories, bound_of_part(task, found.bound, len(found.categories))
            )
        found = self._one_by_one(points)
        fewer, bound = programme.solve(found.bound, len(found.categories) - 1)
        found = Completion(found.categories if fewer is None else self._points(fewer), bound)
        return found if found.smallest else found.better(self._quick_completion(points))

    def _quick_completion(self, points: Ints) -> Completion:
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

    def _each_condition_alone(self, missing: Ints) -> Ints:
        """Each condition lists the categories that it still wants, as often as it wants them, padded with its first category."""
        lists = np.split(missing, self._problem.first[1:])
        rows = np.zeros((max(int(wanted.sum()) for wanted in lists), len(lists)), np.int64)
        for condition, wanted in enumerate(lists):
            rows[: int(wanted.sum()), condition] = np.repeat(np.arange(len(wanted)), wanted)
        return rows

    def _wanting(self, missing: Ints) -> _Wanting:
        cells, places = np.flatnonzero(missing), []
        for cell in cells:
            columns, categories = self._problem.cell(int(cell))
            plane = int(np.searchsorted(self._problem.first, cell, side="right"))
            places.append((plane, columns.tolist(), categories.tolist()))
        return _Wanting(places, missing[cells], self._worth(missing)[cells])

    def _worth(self, missing: Ints) -> Ints:
        return np.where(missing > 0, self._wanted if self._heavy_first else 1, 0)

    def _best(self, missing: Ints) -> Int32s:
        """The best single row found."""
        problem = self._problem
        cells = np.flatnonzero(missing)
        starts = np.array(
            [
                self._row_with(int(cell))
                for cell in cells[self._rng.integers(len(cells), size=STARTS)]
            ]
        )
        held = np.zeros(len(problem.sizes), np.bool_)
        return problem.best_row(
            starts, self._worth(missing), held, SWEEPS, int(self._rng.integers(2**31))
        )

    def _row_with(self, cell: int) -> Int32s:
        columns, categories = self._problem.cell(cell)
        return feasible_row(self._constraints, columns, categories, self._rng)

    def _changed_together(self, missing: Ints, rows: Int32s) -> Int32s:
        problem, changed = self._problem, rows.copy()
        # Cells that are already covered may be left and entered freely.
        counts = np.where(missing > 0, np.int32(0), INFEASIBLE)
        problem.count(changed, counts)
        problem.anneal(
            changed, counts, ANNEALING_STEPS, TEMPERATURES, int(self._rng.integers(2**31))
        )
        return changed

    def _after(self, missing: Ints, rows: Int32s) -> Ints:
        """What is still missing after the rows are added."""
        problem, counts = self._problem, np.zeros(len(missing), np.int32)
        problem.count(rows, counts)
        return np.asarray(np.maximum(0, missing - counts), np.int64)

    def _gain(self, missing: Ints, rows: Int32s) -> int:
        return int(((missing - self._after(missing, rows)) * self._worth(missing)).sum())

    def _bound(self, missing: Ints, count: int) -> int:
        """Upper bound of a gain: a point lies in one cell of each plane, so it gains at most the worth of the best cell, and no more
        than is missing."""
        # A heavy cell may be worth the square of its weight, which only Python's whole numbers hold.
        worth, first = (
            self._worth(missing).astype(object if self._heavy_first else np.int64),
            self._problem.first,
        )
        return int(
            np.minimum(
                count * np.maximum.reduceat(worth, first), np.add.reduceat(missing * worth, first)
            ).sum()
        )


@dataclass(frozen=True)
class _Wanting:
    """The cells that a 0-1 programme may fill. places: the plane of each, and its columns and categories. missing, worth: (cells,)."""

    places: list[tuple[int, list[int], list[int]]]
    missing: Ints
    worth: Ints


def _solve(
    wanted: _Wanting, constraints: Constraints, count: int, time_limit_s: float
) -> tuple[Int32s | None, int]:
    """Solve for `count` points by 0-1 programming; None if time ran out before a solution, and an upper bound of their worth.

    Not the encoding of Algorithm 2, which has a loose relaxation: the cells in one line of a plane exclude each other, so together they
    need no more than the category of that line.
    """
    sizes = constraints.sizes
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    programme = _Programme()
    for _ in range(count):
        _add_point(programme, first, constraints)
    reached: list[dict[int, float]] = [{} for _ in wanted.places]
    for point in range(count):
        _add_occupied(programme, wanted, first, point * int(first[-1]), reached)
    gains = programme.columns(len(wanted.places), upper=wanted.missing, value=wanted.worth)
    for i, row in enumerate(reached):
        programme.row({**row, gains + i: 1.0}, -np.inf, 0)
    solution, bound = programme.solve(time_limit_s)
    if solution is None:
        return None, bound
    chosen = solution[: count * int(first[-1])].reshape(count, -1)
    rows = [
        [int(np.argmax(point[first[v] : first[v + 1]])) for v in range(len(sizes))]
        for point in chosen
    ]
    return np.array(rows, np.int32), bound


def _add_point(programme: _Programme, first: Ints, constraints: Constraints) -> None:
    """A column for each category of each variable; a feasible point has exactly one per variable. first: a variable's first column."""
    begin = programme.columns(int(first[-1]), whole=True)
    for variable in range(len(constraints.sizes)):
        programme.row({begin + c: 1.0 for c in range(first[variable], first[variable + 1])}, 1, 1)
    for clause in constraints.clauses:
        row: dict[int, float] = {}
        low = 1.0
        for literal in clause:
            column = begin + int(first[literal.variable]) + literal.category
            row[column] = row.get(column, 0.0) + (1.0 if literal.equal else -1.0)
            low -= not literal.equal
        programme.row(row, low, np.inf)


def _add_occupied(
    programme: _Programme,
    wanted: _Wanting,
    first: Ints,
    begin: int,
    reached: list[dict[int, float]],
) -> None:
    """A column for each cell that the point with categories from column `begin` on may lie in; `reached` records it by cell."""
    occupied = programme.columns(len(wanted.places))
    lines: dict[tuple[int, int, int], dict[int, float]] = {}
    for i, (plane, columns, categories) in enumerate(wanted.places):
        reached[i][occupied + i] = -1.0
        for column, category in zip(columns, categories, strict=True):
            lines.setdefault((plane, column, category), {})[occupied + i] = 1.0
    for (_, column, category), line in lines.items():
        programme.row({**line, begin + int(first[column]) + category: -1.0}, -np.inf, 0)


class _Programme:
    """Rows and columns of a mixed 0-1 programme."""

    def __init__(self) -> None:
        self._whole: list[bool] = []
        self._upper: list[float] = []
        self._value: list[float] = []
        self._rows: list[tuple[dict[int, float], float, float]] = []

    def columns(
        self, count: int, *, whole: bool = False, upper: ArrayLike = 1, value: ArrayLike = 0
    ) -> int:
        """Add columns from 0 to `upper` that are worth `value` each; returns the first."""
        first = len(self._whole)
        self._whole += [whole] * count
        self._upper += np.broadcast_to(upper, count).tolist()
        self._value += np.broadcast_to(value, count).tolist()
        return first

    def row(self, row: dict[int, float], low: float, high: float) -> None:
        self._rows.append((row, low, high))

    def solve(self, time_limit_s: float) -> tuple[np.ndarray | None, int]:
        """The best solution found, and an upper bound of the value."""
        entries = [
            (value, i, column)
            for i, (row, _, _) in enumerate(self._rows)
            for column, value in row.items()
        ]
        values, rows, columns = zip(*entries, strict=True)
        matrix = csr_array((values, (rows, columns)), shape=(len(self._rows), len(self._whole)))
        limits = LinearConstraint(
            matrix, [low for _, low, _ in self._rows], [high for _, _, high in self._rows]
        )
        result = milp(
            -np.array(self._value),
            integrality=np.array(self._whole),
            bounds=Bounds(0, np.array(self._upper)),
            constraints=limits,
            options={"time_limit": time_limit_s},
        )
        best = (
            np.dot(self._value, self._upper)
            if result.mip_dual_bound is None
            else -result.mip_dual_bound
        )
        return (None if result.x is None else np.asarray(result.x)), int(np.floor(best + 1e-6))
