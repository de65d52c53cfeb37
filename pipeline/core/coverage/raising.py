"""The points of a stream that raise its coverage: in each cell the first ones, as many as it wants.

They alone fill every cell as far as all points do, up to what it wants. So they stand for a table that is too large to keep.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.core.coverage.projection import Demand, Plane, planes
from pipeline.core.variable import Ints

NONE = -1
"""In place of a variable, where a plane has fewer than others."""


class RaisingPoints:
    """Counts the points of a stream, which arrive in batches, and keeps those that raise its coverage."""

    def __init__(self, demand: Demand) -> None:
        self.counts, self._demand = demand.counts(), demand
        every = self.planes()
        self._wanted = np.concatenate([plane.wanted.ravel() for plane in every])
        self._left = self._wanted.copy()
        self._start = np.cumsum([0, *(plane.wanted.size for plane in every[:-1])])
        # Named planes may have fewer or more variables than the others.
        self._variables = np.full(
            (len(every), max(len(plane.variables) for plane in every)), NONE, np.int64
        )
        for row, plane in zip(self._variables, every, strict=True):
            row[: len(plane.variables)] = plane.variables
        self._points, self._places, self._gains = (
            [np.zeros(shape, np.int64)] for shape in ((0, len(demand.sizes)), 0, 0)
        )

    def add(self, rows: Ints) -> None:
        """Add (n, d) points, -1 for an unknown category."""
        before = self.counts.points
        self.counts.add(rows)
        rising = np.add.reduceat(
            self._left - np.maximum(self._wanted - self.counts.flat, 0), self._start
        )
        chosen = np.flatnonzero(rising)
        if not len(chosen):
            return
        gains, sizes = np.zeros(len(rows), np.int64), np.asarray(self._demand.sizes, np.int64)
        columns = np.ascontiguousarray(rows.T, np.int64)
        _mark(
            columns,
            sizes,
            self._variables[chosen],
            self._start[chosen],
            rising[chosen],
            self._left,
            gains,
        )
        raising = np.flatnonzero(gains)
        self._points.append(rows[raising])
        self._places.append(before + raising)
        self._gains.append(gains[raising])

    @property
    def points(self) -> Ints:
        """The points that raised coverage, (m, d)."""
        return np.concatenate(self._points)

    def planes(self) -> list[Plane]:
        """Every plane with the counts of all points so far."""
        return list(planes(self.counts, self._demand))

    def covered_after(self, ends: Ints) -> Ints:
        """Numerator of the coverage after the first points, for each of (m,) numbers of points."""
        sums = np.concatenate([[0], np.cumsum(np.concatenate(self._gains))])
        return np.asarray(sums[np.searchsorted(np.concatenate(self._places), ends)], np.int64)


@njit(cache=True, boundscheck=False)  # type: ignore[untyped-decorator]
def _mark(
    columns: Ints, sizes: Ints, chosen: Ints, start: Ints, rising: Ints, left: Ints, gains: Ints
) -> None:
    """Count in `gains` the cells that each point raises, and take it from what is left; rising: the sum of that for each chosen plane."""
    for index in range(len(chosen)):
        needed, row = rising[index], 0
        while needed > 0:
            cell, known = 0, True
            for position in range(chosen.shape[1]):
                variable = chosen[index, position]
                if variable >= 0:
                    category = columns[variable, row]
                    known &= category >= 0
                    cell = cell * sizes[variable] + category
            if known and left[start[index] + cell] > 0:
                left[start[index] + cell] -= 1
                gains[row] += 1
                needed -= 1
            row += 1
