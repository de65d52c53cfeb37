"""Counts the points in each cell of every plane: bit sets and popcounts for small planes, histograms for others.

A category's bit set has one bit per point. The number of points in a cell is the popcount of an AND. The last category of a condition is
never counted: its counts follow by subtraction from the plane with one condition fewer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from pipeline.core.space import Ints

Words = NDArray[np.uint64]
BLOCK_WORDS = 512
"""Words of a bit set that are processed at a time, so that the bit sets of many categories stay in the cache."""
SMALL_CELLS = 200
"""Planes with more cells are counted by a histogram."""
FEW_POINTS = 2048


class _Bits(NamedTuple):
    """Points as bit sets. words: (sets, words) bit p of word w is point 64 w + p. first: the first set of each condition, which has a
    set for each category but the last. sizes: (d,) categories of each condition."""

    words: Words
    first: Ints
    sizes: Ints
    points: int


class _Cells(NamedTuple):
    """Counts of the cells of all pairs or triples of conditions, in the order of `combinations`. start: first cell of each. wanted: the
    pairs or triples to count."""

    start: Ints
    wanted: NDArray[np.bool_]
    counts: Ints


class CellCounts:
    """Counts of points in the cells of all k-subsets of conditions; points arrive in batches.

    sizes: number of categories of each condition. k: 1 to d.
    """

    def __init__(self, sizes: Sequence[int], k: int) -> None:
        if not 1 <= k <= len(sizes):
            raise ValueError(f"k must be in [1, {len(sizes)}], got {k}")
        self.sizes, self.k, self.points = tuple(sizes), k, 0
        self.planes = np.array(list(combinations(range(len(sizes)), k)), dtype=np.int64).reshape(
            -1, k
        )
        cells = np.prod(np.asarray(self.sizes, dtype=np.int64)[self.planes], axis=1)
        self._start = np.concatenate([[0], np.cumsum(cells)])
        self._counts = np.zeros(int(self._start[-1]), dtype=np.int64)

    def add(self, categories: Ints) -> None:
        """Add (n, d) points to the counts; their category indices must be in range, or -1 for unknown, which is in no cell."""
        rows = np.ascontiguousarray(categories, dtype=np.int64)
        self.points += len(rows)
        if not len(rows):
            return
        if (rows < 0).any():
            self._add_partial(rows)
            return
        by_bits = (
            (np.diff(self._start) <= SMALL_CELLS) & (len(rows) >= FEW_POINTS) & (self.k in (2, 3))
        )
        if by_bits.any():
            self._add_by_bits(rows, by_bits)
        if not by_bits.all():
            columns, sizes = np.ascontiguousarray(rows.T), np.asarray(self.sizes, dtype=np.int64)
            for index in np.flatnonzero(~by_bits):
                _histogram(
                    columns,
                    sizes,
                    self.planes[index],
                    self._counts[self._start[index] : self._start[index + 1]],
                )

    def _add_partial(self, rows: Ints) -> None:
        """Unknown is one more category of the conditions that have it; its cells are dropped."""
        wider = CellCounts(
            [
                size + int((rows[:, condition] < 0).any())
                for condition, size in enumerate(self.sizes)
            ],
            self.k,
        )
        wider.add(np.where(rows < 0, self.sizes, rows))
        for index, chosen in enumerate(self.planes):
            self.plane(index)[...] += wider.plane(index)[
                tuple(slice(self.sizes[condition]) for condition in chosen)
            ]

    def _add_by_bits(self, rows: Ints, by_bits: NDArray[np.bool_]) -> None:
        sizes = np.asarray(self.sizes, dtype=np.int64)
        # Planes of conditions with many categories are never counted by bits.
        used = np.zeros(len(sizes), dtype=np.bool_)
        used[np.unique(self.planes[by_bits])] = True
        first = np.concatenate([[0], np.cumsum(np.where(used, sizes - 1, 0))]).astype(np.int64)
        bits = _Bits(_bit_sets(rows, sizes, used, first), first, sizes, len(rows))
        cells = _Cells(self._start[:-1], by_bits, self._counts)
        if self.k == 2:
            _pairs(bits, cells)
            return
        pairs_of = list(combinations(range(len(sizes)), 2))
        pair_start = np.concatenate(
            [[0], np.cumsum([self.sizes[i] * self.sizes[j] for i, j in pairs_of])]
        ).astype(np.int64)
        wanted = np.array([used[i] and used[j] for i, j in pairs_of])
        pairs = _Cells(pair_start[:-1], wanted, np.zeros(int(pair_start[-1]), dtype=np.int64))
        _pairs(bits, pairs)
        _triples(bits, pairs, cells)

    @property
    def flat(self) -> Ints:
        """Counts of all cells, plane after plane."""
        return self._counts

    @property
    def start(self) -> Ints:
        """First cell of each plane in `flat`."""
        return self._start[:-1]

    def plane(self, index: int) -> Ints:
        """Counts of the plane `planes[index]`, in the shape of its conditions' sizes."""
        shape = tuple(self.sizes[condition] for condition in self.planes[index])
        return self._counts[self._start[index] : self._start[index + 1]].reshape(shape)

    def __iter__(self) -> Iterator[tuple[tuple[int, ...], Ints]]:
        """Each plane's conditions and counts."""
        for index, conditions in enumerate(self.planes.tolist()):
            yield tuple(conditions), self.plane(index)


@intrinsic  # type: ignore[untyped-decorator]
def _popcount(_context: Any, _word: Any) -> Any:
    def generate(_ctx: Any, builder: ir.IRBuilder, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.uint64(types.uint64), generate


@njit(cache=True, boundscheck=False)  # type: ignore[untyped-decorator]
def _histogram(columns: Ints, sizes: Ints, chosen: Ints, counts: Ints) -> None:
    for row in range(columns.shape[1]):
        cell = 0
        for position in range(len(chosen)):
            cell = cell * sizes[chosen[position]] + columns[chosen[position], row]
        counts[cell] += 1


@njit(cache=True, boundscheck=False)  # type: ignore[untyped-decorator]
def _bit_sets(rows: Ints, sizes: Ints, used: NDArray[np.bool_], first: Ints) -> Words:
    """(categories but the last of each used condition, words): bit p of word w is point 64 w + p."""
    points = len(rows)
    bits = np.zeros((first[-1], (points + 63) // 64), np.uint64)
    conditions = np.flatnonzero(used)
    for row in range(points):
        word, bit = row >> 6, np.uint64(1) << np.uint64(row & 63)
        for condition in conditions:
            category = rows[row, condition]
            if category < sizes[condition] - 1:
                bits[first[condition] + category, word] |= bit
    return bits


@njit(cache=True, boundscheck=False, fastmath=True)  # type: ignore[untyped-decorator]
def _pairs(points: _Bits, cells: _Cells) -> None:
    """Add the counts of every wanted pair of conditions."""
    bits, first, sizes, all_points = points
    start, wanted, counts = cells
    words, plane = bits.shape[1], -1
    singles = np.zeros(len(bits), np.int64)
    for category in range(len(bits)):
        total = np.uint64(0)
        for w in range(words):
            total += _popcount(bits[category, w])
        singles[category] = np.int64(total)
    for i in range(len(sizes)):
        for j in range(i + 1, len(sizes)):
            plane += 1
            if not wanted[plane]:
                continue
            at, columns = start[plane], sizes[j]
            last_i, last_j = sizes[i] - 1, sizes[j] - 1
            rest = singles[first[j] : first[j] + last_j].copy()
            corner = all_points
            for b in range(last_j):
                corner -= rest[b]
            for a in range(last_i):
                left = singles[first[i] + a]
                for b in range(last_j):
                    total = np.uint64(0)
                    for w in range(words):
                        total += _popcount(bits[first[i] + a, w] & bits[first[j] + b, w])
                    counts[at + a * columns + b] += np.int64(total)
                    left -= np.int64(total)
                    rest[b] -= np.int64(total)
                counts[at + a * columns + last_j] += left
                corner -= left
            for b in range(last_j):
                counts[at + last_i * columns + b] += rest[b]
            counts[at + last_i * columns + last_j] += corner


@njit(cache=True, boundscheck=False, fastmath=True)  # type: ignore[untyped-decorator]
def _triples(points: _Bits, pairs: _Cells, cells: _Cells) -> None:
    """Add the counts of every wanted triple of conditions; pairs: the counts of every pair of the triples."""
    bits, first, sizes, _ = points
    wanted = cells.wanted
    n, words = len(sizes), bits.shape[1]
    most = (first[1:] - first[:-1]).max()
    both = np.zeros((most * most, BLOCK_WORDS), np.uint64)
    inner_start = _inner_start(sizes, wanted)
    inner = np.zeros(inner_start[-1], np.int64)
    for low in range(0, words, BLOCK_WORDS):
        length, plane = min(BLOCK_WORDS, words - low), -1
        for i in range(n):
            for j in range(i + 1, n):
                vi, vj = sizes[i] - 1, sizes[j] - 1
                made = False
                for k in range(j + 1, n):
                    plane += 1
                    if not wanted[plane]:
                        continue
                    if not made:
                        made = True
                        for a in range(vi):
                            for b in range(vj):
                                for w in range(length):
                                    both[a * vj + b, w] = (
                                        bits[first[i] + a, low + w] & bits[first[j] + b, low + w]
                                    )
                    vk, at = sizes[k] - 1, inner_start[plane]
                    for c in range(vk):
                        third = bits[first[k] + c, low : low + length]
                        for ab in range(vi * vj):
                            row = both[ab]
                            total = np.uint64(0)
                            for w in range(length):
                                total += _popcount(row[w] & third[w])
                            inner[at + ab * vk + c] += np.int64(total)
    _fill_triples(sizes, _Cells(inner_start, wanted, inner), pairs, cells)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _inner_start(sizes: Ints, wanted: NDArray[np.bool_]) -> Ints:
    """First cell of each triple, and the number of cells, without last categories and without triples that are not wanted."""
    n, plane = len(sizes), 0
    start = np.zeros(len(wanted) + 1, np.int64)
    for i in range(n):
        for j in range(i + 1, n):
            for k in range(j + 1, n):
                start[plane + 1] = start[plane]
                if wanted[plane]:
                    start[plane + 1] += (sizes[i] - 1) * (sizes[j] - 1) * (sizes[k] - 1)
                plane += 1
    return start


@njit(cache=True, boundscheck=False)  # type: ignore[untyped-decorator]
def _fill_triples(sizes: Ints, inner_cells: _Cells, pair_cells: _Cells, cells: _Cells) -> None:
    """All counts, from the counts without last categories and those of pairs."""
    inner_start, _, inner = inner_cells
    pair_start, _, pairs = pair_cells
    start, wanted, counts = cells
    n, plane = len(sizes), -1
    for i in range(n):
        for j in range(i + 1, n):
            for k in range(j + 1, n):
                plane += 1
                if not wanted[plane]:
                    continue
                si, sj, sk = sizes[i], sizes[j], sizes[k]
                ij = pair_start[_pair_number(i, j, n)]
                ik = pair_start[_pair_number(i, k, n)]
                jk = pair_start[_pair_number(j, k, n)]
                cube = np.zeros((si, sj, sk), np.int64)
                for a in range(si - 1):
                    for b in range(sj - 1):
                        left = pairs[ij + a * sj + b]
                        for c in range(sk - 1):
                            cube[a, b, c] = inner[
                                inner_start[plane] + (a * (sj - 1) + b) * (sk - 1) + c
                            ]
                            left -= cube[a, b, c]
                        cube[a, b, sk - 1] = left
                    for c in range(sk):
                        left = pairs[ik + a * sk + c]
                        for b in range(sj - 1):
                            left -= cube[a, b, c]
                        cube[a, sj - 1, c] = left
                for b in range(sj):
                    for c in range(sk):
                        left = pairs[jk + b * sk + c]
                        for a in range(si - 1):
                            left -= cube[a, b, c]
                        cube[si - 1, b, c] = left
                at = start[plane]
                for a in range(si):
                    for b in range(sj):
                        for c in range(sk):
                            counts[at + (a * sj + b) * sk + c] += cube[a, b, c]


@njit(cache=True)  # type: ignore[untyped-decorator]
def _pair_number(i: int, j: int, n: int) -> int:
    """Position of the pair in `combinations(range(n), 2)`."""
    return i * (2 * n - i - 1) // 2 + j - i - 1
