"""Pair-wise covering arrays: few tests in which every two categories of different variables meet (thesis section 4.4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heapify, heappop, heappush
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pipeline.core.constraints import Constraints
from pipeline.core.space import Ints

Bools = NDArray[np.bool_]
CANDIDATES = 8
FREE = -1


def covering_array(sizes: Sequence[int], rng: np.random.Generator, constraints: Constraints | None = None) -> Ints:
    """A pair-wise covering array over variables with `sizes` categories each, as (rows, d) category indices.

    Every pair that a feasible point reaches is in some row, and every row is feasible. The smaller of two is returned: a greedy
    array, and, without constraints, one that begins with the full factorial of the two largest variables. No array has
    fewer rows than that factorial, so where nothing is left to add it is minimal. Deterministic for a generator's state.
    """
    limits = constraints or Constraints(tuple(sizes))
    wanted = _wanted_pairs(tuple(sizes), limits)
    if len(sizes) == 1:
        return np.flatnonzero(limits.feasible_cells([0])).astype(np.int64)[:, None]
    if limits.clauses:
        return _complete(np.zeros((0, len(sizes)), dtype=np.int64), wanted, limits, rng)
    frozen = _complete(_factorial_start(tuple(sizes)), wanted, limits, rng)
    first, second = sorted(sizes)[-2:]
    if len(frozen) == first * second:
        return frozen
    greedy = _complete(np.zeros((0, len(sizes)), dtype=np.int64), wanted, limits, rng)
    return min(frozen, greedy, key=len)


def order_by_new_pairs(rows: Ints) -> Ints:
    """Order of (n, d) rows, as (n,) indices, in which each next one covers as many new pairs as any: prefixes cover the most."""
    keys = _pair_keys(rows)
    covered = np.zeros(int(keys.max(initial=-1)) + 1, dtype=bool)
    # Gains only fall as pairs get covered, so a stale gain is an upper bound: only the head of the heap needs counting again.
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


class _Uncovered:
    """The pairs still to cover: `mask[i, a, j, b]` says that category a of variable i has yet to meet b of j. Symmetric."""

    def __init__(self, wanted: dict[tuple[int, int], Bools], sizes: tuple[int, ...]) -> None:
        self.mask = np.zeros((len(sizes), max(sizes), len(sizes), max(sizes)), dtype=bool)
        for (first, second), cells in wanted.items():
            self.mask[first, : sizes[first], second, : sizes[second]] = cells
            self.mask[second, : sizes[second], first, : sizes[first]] = cells.T

    def cover(self, row: Ints) -> None:
        fixed = np.flatnonzero(row != FREE)
        self.mask[fixed[:, None], row[fixed][:, None], fixed[None, :], row[fixed][None, :]] = False

    def gains(self, row: Ints, variable: int) -> Ints:
        """New pairs that each category of `variable` would cover with the fixed cells of the row."""
        fixed = np.flatnonzero(row != FREE)
        return np.asarray(self.mask[fixed, row[fixed], variable].sum(axis=0), dtype=np.int64)

    def gain(self, row: Ints) -> int:
        index = np.arange(len(row))
        return int(self.mask[index[:, None], row[:, None], index[None, :], row[None, :]].sum()) // 2

    def richest(self) -> tuple[int, int]:
        """Variable and category with the most pairs left."""
        left = self.mask.sum(axis=(2, 3))
        variable, category = np.unravel_index(int(np.argmax(left)), left.shape)
        return int(variable), int(category)


def _wanted_pairs(sizes: tuple[int, ...], limits: Constraints) -> dict[tuple[int, int], Bools]:
    return {pair: limits.feasible_cells(pair) for pair in combinations(range(len(sizes)), 2)}


def _complete(start: Ints, wanted: dict[tuple[int, int], Bools], limits: Constraints, rng: np.random.Generator) -> Ints:
    """Fill the free cells of the start rows, then add rows until every wanted pair is covered."""
    uncovered = _Uncovered(wanted, limits.sizes)
    for row in start:
        uncovered.cover(row)
    rows = []
    for row in start:
        full = _fill(row, uncovered, limits, rng)
        uncovered.cover(full)
        rows.append(full)
    while uncovered.mask.any():
        candidates = [_fill(_seed_row(uncovered, rng), uncovered, limits, rng) for _ in range(CANDIDATES)]
        best = max(candidates, key=uncovered.gain)
        uncovered.cover(best)
        rows.append(best)
    return np.array(rows, dtype=np.int64).reshape(-1, len(limits.sizes))


def _seed_row(uncovered: _Uncovered, rng: np.random.Generator) -> Ints:
    """A row that holds one uncovered pair of the category with the most of them, and nothing else."""
    row = np.full(uncovered.mask.shape[0], FREE, dtype=np.int64)
    variable, category = uncovered.richest()
    partners = np.argwhere(uncovered.mask[variable, category])
    other, value = partners[rng.integers(len(partners))]
    row[variable], row[other] = category, value
    return row


def _fill(row: Ints, uncovered: _Uncovered, limits: Constraints, rng: np.random.Generator) -> Ints:
    """Give each free cell, in random order, a category that covers most new pairs and leaves the row feasible."""
    filled = row.copy()
    for variable in rng.permutation(np.flatnonzero(row == FREE)):
        size = limits.sizes[variable]
        gains = uncovered.gains(filled, int(variable))[:size] + rng.random(size)
        for category in np.argsort(-gains, kind="stable"):
            filled[variable] = category
            if not limits.clauses or limits.satisfiable({int(v): int(filled[v]) for v in np.flatnonzero(filled != FREE)}):
                break
    return filled


def _factorial_start(sizes: tuple[int, ...]) -> Ints:
    """Every pair of the two largest variables once; the others by a linear rule where that covers all, else free.

    With B categories of the second largest, B prime, a row (a, b) gets (b + m a) mod B in the m-th other variable. Two
    different m give an orthogonal array, so every pair is covered (Bose 1938); values past a variable's size stay free.
    """
    largest, second, *others = sorted(range(len(sizes)), key=lambda variable: -sizes[variable])
    a, b = (axis.ravel() for axis in np.indices((sizes[largest], sizes[second])))
    rows = np.full((len(a), len(sizes)), FREE, dtype=np.int64)
    rows[:, largest], rows[:, second] = a, b
    if len(others) < sizes[second] and _is_prime(sizes[second]):
        for multiplier, variable in enumerate(others, start=1):
            values = (b + multiplier * a) % sizes[second]
            rows[:, variable] = np.where(values < sizes[variable], values, FREE)
    return rows


def _is_prime(number: int) -> bool:
    return number > 1 and all(number % divisor for divisor in range(2, int(number**0.5) + 1))
