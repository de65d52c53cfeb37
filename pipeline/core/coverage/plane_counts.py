"""Counts of points in the cells of planes of different sizes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from pipeline.core.coverage.counting import CellCounts
from pipeline.core.coverage.mixed import Mixed, all_planes
from pipeline.core.space import Ints


class PlaneCounts:
    """Counts of points in the cells of all planes of a mixed strength; points arrive in batches.

    Args:
        sizes: number of categories of each of the d variables.
        mixed: the planes.

    Attributes:
        points: number of points so far.
    """

    def __init__(self, sizes: Sequence[int], mixed: Mixed) -> None:
        self.points, self._planes = 0, all_planes(len(sizes), mixed)
        parts = [(tuple(range(len(sizes))), mixed.strength)]
        parts += [(named.variables, named.strength) for named in mixed.extras.planes]
        for plane, wanted in self._planes.items():
            if wanted is not None:
                parts.append((plane, len(plane)))
        self._parts = []
        for variables, strength in parts:
            counts = CellCounts([sizes[v] for v in variables], strength)
            self._parts.append((list(variables), counts))

    def add(self, categories: Ints) -> None:
        """Add points to the counts.

        Args:
            categories: (n, d) category indices in range, or -1 for unknown, which is in no cell.
        """
        self.points += len(categories)
        for variables, counts in self._parts:
            counts.add(categories[:, variables])

    @property
    def flat(self) -> Ints:
        """Counts of all cells, plane after plane."""
        return np.concatenate([cells.ravel() for _, cells in self])

    def __iter__(self) -> Iterator[tuple[tuple[int, ...], Ints]]:
        """Each plane's variables and counts, in the order of `all_planes`."""
        cells_of: dict[tuple[int, ...], Ints] = {}
        for variables, counts in self._parts:
            for positions, cells in counts:
                cells_of[tuple(variables[position] for position in positions)] = cells
        return iter([(plane, cells_of[plane]) for plane in self._planes])
