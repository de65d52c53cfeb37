"""Counts of points in the cells of planes of different sizes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from pipeline.core.coverage.counting import CellCounts
from pipeline.core.coverage.mixed import Mixed, all_planes
from pipeline.core.space import Ints


class PlaneCounts:
    """Counts of points in the cells of all planes of a mixed strength; points arrive in batches."""

    def __init__(self, sizes: Sequence[int], mixed: Mixed) -> None:
        self._planes = all_planes(len(sizes), mixed)
        parts = [
            (tuple(range(len(sizes))), mixed.strength),
            *((named.variables, named.strength) for named in mixed.extras.planes),
        ]
        parts += [
            (plane, len(plane)) for plane, wanted in self._planes.items() if wanted is not None
        ]
        self._parts = [
            (list(variables), CellCounts([sizes[v] for v in variables], strength))
            for variables, strength in parts
        ]

    @property
    def points(self) -> int:
        """Number of points so far."""
        return self._parts[0][1].points

    def add(self, categories: Ints) -> None:
        """Add (n, d) points to the counts; their category indices must be in range, or -1 for unknown, which is in no cell."""
        for variables, counts in self._parts:
            counts.add(categories[:, variables])

    @property
    def flat(self) -> Ints:
        """Counts of all cells, plane after plane."""
        return np.concatenate([cells.ravel() for _, cells in self])

    def __iter__(self) -> Iterator[tuple[tuple[int, ...], Ints]]:
        """Each plane's variables and counts, in the order of `all_planes`."""
        found = {
            tuple(variables[v] for v in chosen): cells
            for variables, counts in self._parts
            for chosen, cells in counts
        }
        return iter([(plane, found[plane]) for plane in self._planes])
