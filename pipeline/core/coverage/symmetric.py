"""Symmetric covering arrays: a few rows whose images under a group of symmetries cover every cell.

A group rotates cycles of columns and moves the categories of all columns alike. Cells that it maps
to each other form a class, and a row's images cover every class that the row touches. So the search
places only the starter rows and covers classes, which are fewer than the cells by about the order
of the group (Chateauneuf, Colbourn and Kreher 1999; Meagher and Stevens 2005).
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
"""Elementary steps of a symmetry's first search; further searches take multiples of it."""
PATIENCE = 0.4
"""How fast a symmetry's rank falls with the steps spent on it in vain.

The rank starts with the smallest share of classes that its searches left uncovered."""
TEMPERATURES = ((0.8, 0.4), (1.0, 0.2))
"""First and last temperature in classes: the first suits large groups, the second small ones."""
MOST_CELLS = 200_000


@dataclass(frozen=True)
class Symmetry:
    """A group, by its generators, and constant rows beside the orbits.

    Attributes:
        rotation: (n,) the column that each column moves to.
        maps: permutations (v,) of the categories.
        order: of the group.
        constants: the categories of rows that have one category everywhere.
    """

    rotation: Ints
    maps: tuple[Ints, ...]
    order: int
    constants: tuple[int, ...]

    def orbits(self, starters: Int32s) -> Int32s:
        """All images of the starter rows, (m, n), and the constant rows; each row once.

        >>> Symmetry(np.array([1, 2, 0]), (), 3, (1,)).orbits(np.array([[0, 0, 1]])).tolist()
        [[0, 0, 1], [0, 1, 0], [1, 0, 0], [1, 1, 1]]
        """
        rows = {tuple(row) for row in starters.tolist()}
        todo = list(rows)
        while todo:
            row = np.array(todo.pop())
            rotated = np.empty_like(row)
            rotated[self.rotation] = row
            images = [rotated, *(of[row] for of in self.maps)]
            new = {tuple(image.tolist()) for image in images} - rows
            rows |= new
            todo += new
        rows |= {(category,) * len(self.rotation) for category in self.constants}
        return np.array(sorted(rows), np.int32)


def symmetries(columns: int, categories: int) -> list[Symmetry]:
    """Symmetries of arrays of columns with equally many categories."""
    result = []
    for length in range(1, columns + 1):
        turning = columns // length * length
        if columns - turning > FIXED_COLUMNS:
            continue
        rotation, turned = np.arange(columns), np.arange(turning)
        rotation[:turning] = turned // length * length + (turned + 1) % length
        for maps, order, sets_of_constants in _category_groups(categories):
            if length * order > 1:
                for constants in sets_of_constants:
                    result.append(Symmetry(rotation, maps, length * order, constants))
    return result


def _category_groups(
    categories: int,
) -> Iterator[tuple[tuple[Ints, ...], int, list[tuple[int, ...]]]]:
    """Generators and order of groups on the categories, and sets of constant rows to try."""
    every, last = tuple(range(categories)), categories - 1
    shifted = np.append((np.arange(last) + 1) % max(1, last), last)
    yield (shifted,), max(1, last), [(), (last,), every]
    arithmetic = galois_field(categories)
    if arithmetic is None:
        yield ((np.arange(categories) + 1) % categories,), categories, [(), every]
        return
    # x -> a x + b for every b, and a in a subgroup of the field's units (AGL(1, q) and subgroups).
    units = arithmetic.powers()
    for index in divisors(last):
        multiply = (arithmetic.times[units[index % last]],) if index < last else ()
        yield (*arithmetic.translations(), *multiply), categories * (last // index), [(), every]


class SymmetricSearch:
    """Searches symmetric arrays over equally large columns, the most promising symmetry first.

    Args:
        sizes: number of categories of each column.
        strength: t.
        rng: source of all random draws.
    """

    def __init__(self, sizes: tuple[int, ...], strength: int, rng: np.random.Generator) -> None:
        self._sizes, self._categories, self._rng = np.array(sizes), max(sizes), rng
        self._problem = of_strength(Constraints((self._categories,) * len(sizes)), strength)
        self._queue = []
        for number, symmetry in enumerate(symmetries(len(sizes), self._categories)):
            self._queue.append(_Candidate(0.0, -symmetry.order, number, symmetry))
        heapify(self._queue)

    @staticmethod
    def suits(sizes: tuple[int, ...], strength: int) -> bool:
        """Whether most columns have the largest size and the cells are few enough."""
        most = max(sizes)
        cells = np.prod([(len(sizes) - i) * most / (i + 1) for i in range(strength)])
        uniform = most > 1 and 3 * sizes.count(most) >= 2 * len(sizes)
        return uniform and 2 <= strength < len(sizes) and bool(cells <= MOST_CELLS)

    def smaller(self, fewer_than: int, go_on: Callable[[], bool]) -> Int32s | None:
        """The next array with fewer rows.

        Args:
            fewer_than: the array must have fewer rows.
            go_on: whether there is time for another search.

        Returns:
            (rows, n) categories, free (-1) beyond a column's size; None if the time is over.
        """
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
    """A symmetry in the queue.

    rank: smallest first.
    fails, spent, least: since the last success, number of failed searches, their total length, and
    the smallest share of classes that they left.
    """

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
        constants = np.array(self.symmetry.constants, np.int32)
        fixed = np.repeat(constants[:, None], columns, axis=1).reshape(-1, columns)
        cells = problem.counts(np.vstack([starters, fixed]))
        counts = np.bincount(self.of_cell, weights=cells, minlength=classes).astype(np.int32)
        steps = int(FIRST_OPERATIONS * luby(self.fails + 1) / problem.grid.lines.base.shape[1])
        hot, cold = TEMPERATURES[self.fails % len(TEMPERATURES)]
        plan, seed = (categories, steps, hot, cold), int(rng.integers(2**31))
        left = anneal_starters(problem.grid.lines, self.of_cell, counts, starters, plan, seed)
        return starters, left / classes

    def next(self, left: float) -> _Candidate:
        """The candidate after a search that left a share of the classes.

        It goes to the front after a success, else it is ranked by the least that was left.
        """
        if not left:
            return replace(self, rank=0.0, fails=0, spent=0, least=1.0)
        spent, least = self.spent + luby(self.fails + 1), min(self.least, left)
        rank = least * (1 + spent) ** PATIENCE
        return replace(self, rank=rank, fails=self.fails + 1, spent=spent, least=least)


def luby(number: int) -> int:
    """Length of the n-th search, n >= 1, whose best length is unknown.

    No other order of lengths needs much less time (Luby, Sinclair and Zuckerman 1993).

    >>> [luby(number) for number in range(1, 9)]
    [1, 1, 2, 1, 1, 2, 4, 1]
    """
    power = number.bit_length()
    return 1 << (power - 1) if number == (1 << power) - 1 else luby(number - (1 << (power - 1)) + 1)


def _classes(problem: Problem, symmetry: Symmetry) -> Int32s:
    """Class of each cell, (cells,)."""
    planes, categories = problem.grid.planes.astype(np.int64), int(problem.sizes[0])
    cells = categories ** planes.shape[1]
    digits = np.array(np.unravel_index(np.arange(cells), (categories,) * planes.shape[1]))
    same = np.arange(len(planes) * cells).reshape(len(planes), cells)
    # The cell that each cell of each plane moves to, (planes, cells).
    turned = symmetry.rotation[planes]
    order = np.argsort(turned, axis=1)
    numbers = _number(np.take_along_axis(turned, order, axis=1).T, len(problem.sizes))
    plane = np.searchsorted(_number(planes.T, len(problem.sizes)), numbers)
    images = [plane[:, None] * cells + _number(digits[order.T], categories)]
    for of in symmetry.maps:
        images.append(np.arange(len(planes))[:, None] * cells + _number(of[digits], categories))
    start = np.tile(same.ravel(), len(images))
    end = np.concatenate([image.ravel() for image in images])
    moves = coo_array((np.ones(len(start), np.int8), (start, end)))
    return np.asarray(connected_components(moves)[1], np.int32)


def _number(digits: Ints, base: int) -> Ints:
    """The numbers with these digits along the first axis, the most significant first."""
    result = np.zeros(digits.shape[1:], np.int64)
    for digit in digits:
        result = result * base + digit
    return result
