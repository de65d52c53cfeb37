"""Counts of points in the cells of all planes: bit sets for small planes, histograms for others.

A category's bit set has one bit per point. The number of points in a cell is the popcount of an
AND. The last category of a condition is never counted: its counts follow by subtraction from the
plane with one condition fewer.
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
"""Words of a bit set processed at a time, so that the bit sets of many categories stay in cache."""
SMALL_CELLS = 200
"""Planes with more cells are counted by a histogram."""
FEW_POINTS = 2048
"""Smaller batches are counted by histograms, because setting up bit sets costs more."""


class _Bits(NamedTuple):
    """Points as bit sets.

    words: (sets, words); bit p of word w is point 64 w + p.
    first: (d + 1,) first set of each condition, which has a set for each category but the last.
    sizes: (d,) categories of each condition.
    """

    words: Words
    first: Ints
    sizes: Ints
    points: int


class _Cells(NamedTuple):
    """Counts of the cells of all pairs or triples of conditions, in the order of `combinations`.

    start: first cell of each pair or triple.
    wanted: whether to count each pair or triple.
    counts: (cells,).
    """

    start: Ints
    wanted: NDArray[np.bool_]
    counts: Ints


class CellCounts:
    """Counts of points in the cells of all k-subsets of conditions; points arrive in batches.

    Args:
        sizes: number of categories of each of the d conditions.
        k: number of conditions in a plane, in [1, d].

    Attributes:
        points: number of points so far.
        planes: (planes, k) conditions of each plane, in the order of `combinations`.
        flat: (cells,) counts of all cells, plane after plane.
        start: (planes,) first cell of each plane in `flat`.

    Raises:
        ValueError: if k is out of range.

    >>> counts = CellCounts([2, 3], k=1)
    >>> counts.add(np.array([[0, 2], [1, 2], [1, -1]]))
    >>> counts.points, counts.flat.tolist()
    (3, [1, 2, 0, 0, 2])
    """

    def __init__(self, sizes: Sequence[int], k: int) -> None:
        if not 1 <= k <= len(sizes):
            raise ValueError(f"k must be in [1, {len(sizes)}], got {k}")
        self.sizes, self.k, self.points = tuple(sizes), k, 0
        subsets = list(combinations(range(len(sizes)), k))
        self.planes = np.array(subsets, dtype=np.int64).reshape(-1, k)
        cells = np.prod(np.asarray(self.sizes, dtype=np.int64)[self.planes], axis=1)
        self._bounds = np.concatenate([[0], np.cumsum(cells)])
        self.start: Ints = self._bounds[:-1]
        self.flat: Ints = np.zeros(int(self._bounds[-1]), dtype=np.int64)

    def add(self, categories: Ints) -> None:
        """Add points to the counts.

        Args:
            categories: (n, d) category indices in range, or -1 for unknown. A point with an
                unknown category is in no cell of that condition's planes.
        """
        rows = np.ascontiguousarray(categories, dtype=np.int64)
        self.points += len(rows)
        if not len(rows):
            return
        unknown = rows < 0
        if unknown.any():
            # Unknown is one more category of the conditions that have it; its cells are dropped.
            wider = CellCounts(np.add(self.sizes, unknown.any(axis=0)).tolist(), self.k)
            wider.add(np.where(unknown, self.sizes, rows))
            for index, conditions in enumerate(self.planes):
                inside = tuple(slice(self.sizes[condition]) for condition in conditions)
                self.plane(index)[...] += wider.plane(index)[inside]
            return
        by_bits = np.diff(self._bounds) <= SMALL_CELLS
        by_bits &= len(rows) >= FEW_POINTS and self.k in (2, 3)
        if by_bits.any():
            self._add_by_bits(rows, by_bits)
        if not by_bits.all():
            columns, sizes = np.ascontiguousarray(rows.T), np.asarray(self.sizes, dtype=np.int64)
            for index in np.flatnonzero(~by_bits).tolist():
                cells = self.flat[self._bounds[index] : self._bounds[index + 1]]
                _histogram(columns, sizes, self.planes[index], cells)

    def _add_by_bits(self, rows: Ints, by_bits: NDArray[np.bool_]) -> None:
        """Count the chosen planes, (planes,), of pairs or triples of conditions by bit sets."""
        sizes = np.asarray(self.sizes, dtype=np.int64)
        # Planes of conditions with many categories are never counted by bits.
        used = np.zeros(len(sizes), dtype=np.bool_)
        used[np.unique(self.planes[by_bits])] = True
        first = np.concatenate([[0], np.cumsum(np.where(used, sizes - 1, 0))]).astype(np.int64)
        bits = _Bits(_bit_sets(rows, sizes, used, first), first, sizes, len(rows))
        cells = _Cells(self.start, by_bits, self.flat)
        if self.k == 2:
            _pairs(bits, cells)
            return
        subsets = np.array(list(combinations(range(len(sizes)), 2)), dtype=np.int64)
        pairs = _cells(np.prod(sizes[subsets], axis=1), np.all(used[subsets], axis=1))
        _pairs(bits, pairs)
        # Last categories are left out, and so are triples that are not wanted.
        inner = _cells(np.prod(sizes[self.planes] - 1, axis=1) * by_bits, by_bits)
        _triples(bits, inner)
        _fill_triples(sizes, inner, pairs, cells)

    def plane(self, index: int) -> Ints:
        """Counts of the plane `planes[index]`, in the shape of its conditions' sizes."""
        shape = tuple(self.sizes[condition] for condition in self.planes[index])
        return self.flat[self._bounds[index] : self._bounds[index + 1]].reshape(shape)

    def __iter__(self) -> Iterator[tuple[tuple[int, ...], Ints]]:
        """Each plane's conditions and counts."""
        for index, conditions in enumerate(self.planes.tolist()):
            yield tuple(conditions), self.plane(index)


def _cells(lengths: Ints, wanted: NDArray[np.bool_]) -> _Cells:
    """Empty counts of planes with the given numbers of cells."""
    bounds = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    return _Cells(bounds[:-1], wanted, np.zeros(int(bounds[-1]), dtype=np.int64))


@intrinsic  # type: ignore[untyped-decorator]
def _popcount(_context: Any, _word: Any) -> Any:
    def generate(_ctx: Any, builder: ir.IRBuilder, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.uint64(types.uint64), generate


@njit(cache=True, nogil=True, boundscheck=False)  # type: ignore[untyped-decorator]
def _histogram(columns: Ints, sizes: Ints, chosen: Ints, counts: Ints) -> None:
    for row in range(columns.shape[1]):
        cell = 0
        for position in range(len(chosen)):
            cell = cell * sizes[chosen[position]] + columns[chosen[position], row]
        counts[cell] += 1


@njit(cache=True, nogil=True, boundscheck=False)  # type: ignore[untyped-decorator]
def _bit_sets(rows: Ints, sizes: Ints, used: NDArray[np.bool_], first: Ints) -> Words:
    """Bit sets of every category but the last of each used condition, (sets, words)."""
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


@njit(cache=True, nogil=True, boundscheck=False, fastmath=True)  # type: ignore[untyped-decorator]
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


@njit(cache=True, nogil=True, boundscheck=False, fastmath=True)  # type: ignore[untyped-decorator]
def _triples(points: _Bits, inner: _Cells) -> None:
    """Add the counts of the cells without last categories of every wanted triple of conditions."""
    bits, first, sizes, _ = points
    start, wanted, counts = inner
    n, words = len(sizes), bits.shape[1]
    most = (first[1:] - first[:-1]).max()
    both = np.zeros((most * most, BLOCK_WORDS), np.uint64)
    for low in range(0, words, BLOCK_WORDS):
        length, plane = min(BLOCK_WORDS, words - low), -1
        for i in range(n):
            for j in range(i + 1, n):
                vi, vj = sizes[i] - 1, sizes[j] - 1
                combined = False
                for k in range(j + 1, n):
                    plane += 1
                    if not wanted[plane]:
                        continue
                    if not combined:
                        combined = True
                        for a in range(vi):
                            for b in range(vj):
                                for w in range(length):
                                    both[a * vj + b, w] = (
                                        bits[first[i] + a, low + w] & bits[first[j] + b, low + w]
                                    )
                    vk, at = sizes[k] - 1, start[plane]
                    for c in range(vk):
                        third = bits[first[k] + c, low : low + length]
                        for ab in range(vi * vj):
                            row = both[ab]
                            total = np.uint64(0)
                            for w in range(length):
                                total += _popcount(row[w] & third[w])
                            counts[at + ab * vk + c] += np.int64(total)


@njit(cache=True, nogil=True, boundscheck=False)  # type: ignore[untyped-decorator]
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
