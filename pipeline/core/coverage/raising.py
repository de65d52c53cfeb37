"""The points of a stream that raise its coverage: in each cell the first ones, as many as it wants.

They alone fill every cell as far as all points do, up to what it wants. So they stand for a table
that is too large to keep.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.core.coverage.projection import Demand, Plane, planes
from pipeline.core.variable import Ints

NONE = -1
"""In place of a variable, where a plane has fewer than others."""


class RaisingPoints:
    """Counts the points of a stream and keeps those that raise its coverage.

    Args:
        demand: what full coverage wants.

    Attributes:
        counts: counts of all points so far, over the planes of the demand.

    >>> from pipeline.core.constraints import Constraints
    >>> stream = RaisingPoints(Demand(Constraints((2, 2)), k=1))
    >>> stream.add(np.array([[0, 0], [0, 0], [0, 1]]))
    >>> stream.points.tolist(), stream.covered_after(np.array([1, 2, 3])).tolist()
    ([[0, 0], [0, 1]], [2, 2, 3])
    """

    def __init__(self, demand: Demand) -> None:
        self.counts, self._demand = demand.counts(), demand
        every = self.planes()
        self._wanted = np.concatenate([plane.wanted.ravel() for plane in every])
        self._left = self._wanted.copy()
        self._start = np.cumsum([0, *(plane.wanted.size for plane in every[:-1])])
        # Named planes may have fewer or more variables than the others.
        most = max(len(plane.variables) for plane in every)
        self._variables = np.full((len(every), most), NONE, np.int64)
        for row, plane in zip(self._variables, every, strict=True):
            row[: len(plane.variables)] = plane.variables
        self._points: list[Ints] = [np.zeros((0, len(demand.sizes)), np.int64)]
        self._places: list[Ints] = [np.zeros(0, np.int64)]
        self._gains: list[Ints] = [np.zeros(0, np.int64)]

    def add(self, rows: Ints) -> None:
        """Add (n, d) points, -1 for an unknown category."""
        before = self.counts.points
        self.counts.add(rows)
        left = np.maximum(self._wanted - self.counts.flat, 0)
        rising = np.add.reduceat(self._left - left, self._start)
        chosen = np.flatnonzero(rising)
        if not len(chosen):
            return
        gains, sizes = np.zeros(len(rows), np.int64), np.asarray(self._demand.sizes, np.int64)
        columns = np.ascontiguousarray(rows.T, np.int64)
        planes = (self._variables[chosen], self._start[chosen], rising[chosen])
        _mark(columns, sizes, *planes, self._left, gains)
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
        """Numerator of the coverage after the first points of the stream, (m,).

        ends: (m,) numbers of points.
        """
        sums = np.concatenate([[0], np.cumsum(np.concatenate(self._gains))])
        return np.asarray(sums[np.searchsorted(np.concatenate(self._places), ends)], np.int64)


@njit(cache=True, nogil=True, boundscheck=False)  # type: ignore[untyped-decorator]
def _mark(
    columns: Ints, sizes: Ints, chosen: Ints, start: Ints, rising: Ints, left: Ints, gains: Ints
) -> None:
    """Count in `gains` the cells that each point raises, and take them from what is left.

    rising: the number of points that raise each chosen plane.
    """
    for index in range(len(chosen)):
        needed, row = rising[index], 0
        while needed > 0:
            cell, complete = 0, True
            for position in range(chosen.shape[1]):
                variable = chosen[index, position]
                if variable >= 0:
                    category = columns[variable, row]
                    complete &= category >= 0
                    cell = cell * sizes[variable] + category
            if complete and left[start[index] + cell] > 0:
                left[start[index] + cell] -= 1
                gains[row] += 1
                needed -= 1
            row += 1
