"""Symmetric covering arrays: a few rows whose images under a group of symmetries cover every cell.

A group rotates cycles of columns and moves the categories of all columns alike. Cells that it maps to each other form a class, and a
row's images cover every class that the row touches. So the search places only the starter rows and covers classes, which are fewer than
the cells by about the order of the group (Chateauneuf, Colbourn and Kreher 1999; Meagher and Stevens 2005).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from heapq import heapify, heappop, heappush

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pipeline.core.constraints import Constraints
from pipeline.core.coverage.fields import divisors, galois_field
from pipeline.core.coverage.grid import Int32s
from pipeline.core.coverage.problem import Problem, of_strength
from pipeline.core.coverage.starters import anneal_starters
from pipeline.core.space import Ints

FIXED_COLUMNS = 2
"""Most columns that a rotation leaves in place."""
FIRST_OPERATIONS = 4e6
"""Elementary steps of a symmetry's first search; further ones take multiples of it."""
PATIENCE = 0.4
"""How fast a symmetry's rank falls with the steps spent on it in vain, beyond the smallest share of classes that they left uncovered."""
TEMPERATURES = ((0.8, 0.4), (1.0, 0.2))
"""First and last temperature in classes: the first suits large groups, the second small ones."""
MOST_CELLS = 200_000


@dataclass(frozen=True)
class Symmetry:
    """A group, by its generators, and constant rows beside the orbits.

    rotation: (n,) the column that each column moves to. maps: permutations (v,) of the categories. order: of the group. constants: the
    categories of rows that have one category everywhere.
    """

    rotation: Ints
    maps: tuple[Ints, ...]
    order: int
    constants: tuple[int, ...]

    def orbits(self, starters: Int32s) -> Int32s:
        """All images of the starter rows, and the constant rows; each row once."""
        rows = {tuple(row) for row in starters.tolist()}
        todo = list(rows)
        while todo:
            row = np.array(todo.pop())
            rotated = np.empty_like(row)
            rotated[self.rotation] = row
            new = {
                tuple(image.tolist()) for image in (rotated, *(of[row] for of in self.maps))
            } - rows
            rows |= new
            todo += new
        rows |= {(category,) * len(self.rotation) for category in self.constants}
        return np.array(sorted(rows), np.int32)


def symmetries(columns: int, categories: int) -> list[Symmetry]:
    """Symmetries of arrays of columns with equally many categories."""
    found = []
    for length in range(1, columns + 1):
        turning = columns // length * length
        if columns - turning > FIXED_COLUMNS:
            continue
        rotation = np.arange(columns)
        rotation[:turning] = (
            np.arange(turning) // length * length + (np.arange(turning) + 1) % length
        )
        for maps, order, constants in _category_groups(categories):
            if length * order > 1:
                found += [Symmetry(rotation, maps, length * order, some) for some in constants]
    return found


def _category_groups(
    categories: int,
) -> Iterator[tuple[tuple[Ints, ...], int, list[tuple[int, ...]]]]:
    """Generators and order of groups on the categories, and the sets of constant rows to try with each."""
    every, last = tuple(range(categories)), categories - 1
    shifted = np.append((np.arange(last) + 1) % last if last > 1 else np.arange(last), last)
    yield (shifted,), max(1, last), [(), (last,), every]
    arithmetic = galois_field(categories)
    if arithmetic is None:
        yield ((np.arange(categories) + 1) % categories,), categories, [(), every]
        return
    # x -> a x + b for every b, and a in a subgroup of the field's units (AGL(1, q) and its subgroups).
    units = arithmetic.powers()
    for index in divisors(last):
        multiply = (arithmetic.times[units[index % last]],) if index < last else ()
        yield (*arithmetic.translations(), *multiply), categories * (last // index), [(), every]


class SymmetricSearch:
    """Searches symmetric arrays over equally large columns, the most promising symmetry first."""

    def __init__(self, sizes: tuple[int, ...], strength: int, rng: np.random.Generator) -> None:
        self._sizes, self._categories, self._rng = np.array(sizes), max(sizes), rng
        self._problem = of_strength(Constraints((self._categories,) * len(sizes)), strength)
        self._queue = [
            _Candidate(0.0, -s.order, i, s)
            for i, s in enumerate(symmetries(len(sizes), self._categories))
        ]
        heapify(self._queue)

    @staticmethod
    def suits(sizes: tuple[int, ...], strength: int) -> bool:
        """Whether most columns have the largest size and the cells are few enough."""
        most = max(sizes)
        cells = np.prod([(len(sizes) - i) * most / (i + 1) for i in range(strength)])
        uniform = most > 1 and 3 * sizes.count(most) >= 2 * len(sizes)
        return uniform and 2 <= strength < len(sizes) and bool(cells <= MOST_CELLS)

    def smaller(self, fewer_than: int, go_on: Callable[[], bool]) -> Int32s | None:
        """The next array with fewer rows, in which categories beyond a column's size are free (-1); None if the time is over."""
        while self._queue and go_on():
            candidate = heappop(self._queue)
            symmetry = candidate.symmetry
            count = (fewer_than - 1 - len(symmetry.constants)) // symmetry.order
            if count < 1:
                continue
            starters, left = candidate.search(self._problem, count, self._rng)
            heappush(self._queue, candidate.next(left))
            if left == 0:
                rows = symmetry.orbits(starters)
                free = np.where(rows < self._sizes, rows, -1)
                return free[(free >= 0).any(axis=1)].astype(np.int32)
        return None


@dataclass(order=True)
class _Candidate:
    """A symmetry in the queue: rank, smallest first; since its last success, failed searches, their length and the least they left."""

    rank: float
    larger_first: int
    number: int
    symmetry: Symmetry = field(compare=False)
    fails: int = field(default=0, compare=False)
    spent: int = field(default=0, compare=False)
    least: float = field(default=1.0, compare=False)
    of_cell: Int32s | None = field(default=None, compare=False)

    def search(
        self, problem: Problem, count: int, rng: np.random.Generator
    ) -> tuple[Int32s, float]:
        """Starter rows and the share of classes that they leave uncovered."""
        if self.of_cell is None:
            self.of_cell = _classes(problem, self.symmetry)
        classes = int(self.of_cell.max()) + 1
        columns, categories = len(problem.sizes), int(problem.sizes[0])
        starters = rng.integers(0, categories, (count, columns)).astype(np.int32)
        fixed = np.repeat(
            np.array(self.symmetry.constants, np.int32)[:, None], columns, axis=1
        ).reshape(-1, columns)
        cells = problem.counts(np.vstack([starters, fixed]))
        counts = np.bincount(self.of_cell, weights=cells, minlength=classes).astype(np.int32)
        steps = int(FIRST_OPERATIONS * luby(self.fails + 1) / problem.grid.lines.base.shape[1])
        hot, cold = TEMPERATURES[self.fails % len(TEMPERATURES)]
        left = anneal_starters(
            problem.grid.lines,
            self.of_cell,
            counts,
            starters,
            (categories, steps, hot, cold),
            int(rng.integers(2**31)),
        )
        return starters, left / classes

    def next(self, left: float) -> _Candidate:
        """The candidate after a search: at the front after a success, else ranked by the least that its searches left."""
        after = replace(self, rank=0.0, fails=0, spent=0, least=1.0)
        if left:
            spent, least = self.spent + luby(self.fails + 1), min(self.least, left)
            after = replace(
                self,
                rank=least * (1 + spent) ** PATIENCE,
                fails=self.fails + 1,
                spent=spent,
                least=least,
            )
        return after


def luby(number: int) -> int:
    """Length of the n-th search, n >= 1: 1, 1, 2, 1, 1, 2, 4, 1, … No order of lengths, whatever suits, needs much less time
    (Luby, Sinclair and Zuckerman 1993)."""
    power = number.bit_length()
    return 1 << (power - 1) if number == (1 << power) - 1 else luby(number - (1 << (power - 1)) + 1)


def _classes(problem: Problem, symmetry: Symmetry) -> Int32s:
    """Class of each cell, (cells,)."""
    planes, categories = problem.grid.planes.astype(np.int64), int(problem.sizes[0])
    cells = categories ** planes.shape[1]
    digits = np.array(np.unravel_index(np.arange(cells), (categories,) * planes.shape[1]))
    same = np.arange(len(planes) * cells).reshape(len(planes), cells)
    images = [_rotated(planes, symmetry.rotation, digits, categories)]
    for of in symmetry.maps:
        images.append(np.arange(len(planes))[:, None] * cells + _number(of[digits], categories))
    start, end = (
        np.tile(same.ravel(), len(images)),
        np.concatenate([image.ravel() for image in images]),
    )
    return np.asarray(
        connected_components(coo_array((np.ones(len(start), np.int8), (start, end))))[1], np.int32
    )


def _rotated(planes: Ints, rotation: Ints, digits: Ints, categories: int) -> Ints:
    """The cell that each cell of each plane moves to, (planes, cells of a plane)."""
    moved = rotation[planes]
    order = np.argsort(moved, axis=1)
    keys = _number(planes.T, len(rotation))
    plane = np.searchsorted(
        keys, _number(np.take_along_axis(moved, order, axis=1).T, len(rotation))
    )
    return np.asarray(plane[:, None] * digits.shape[1] + _number(digits[order.T], categories))


def _number(digits: Ints, base: int) -> Ints:
    """The numbers with these digits along the first axis, the most significant first."""
    result = np.zeros(digits.shape[1:], np.int64)
    for digit in digits:
        result = result * base + digit
    return result
