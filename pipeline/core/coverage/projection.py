"""Quantitative k-projection coverage (Cheng et al., Definition 4)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, reduce
from math import prod
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pipeline.core.constraints import Bools, Constraints
from pipeline.core.coverage.counting import CellCounts
from pipeline.core.coverage.mixed import NOTHING, Extras, Mixed, all_planes
from pipeline.core.coverage.plane_counts import PlaneCounts
from pipeline.core.variable import HEAVIEST, Ints

Combine = Literal["product", "sum", "max"]
Counts = CellCounts | PlaneCounts
_COMBINE = {"product": np.multiply, "sum": np.add, "max": np.maximum}


@dataclass(frozen=True)
class Demand:
    """What full coverage wants: points in every cell of every `k` variables that a feasible point reaches.

    constraints: what is feasible, over all d variables. k: 1 to d. weights: for each variable its (size,) whole numbers of wanted points, 1
    each by default; a cell wants the product, sum or maximum of its categories' weights. extras: more planes, and weights of single cells.
    """

    constraints: Constraints
    k: int
    weights: Sequence[ArrayLike] | None = None
    combine: Combine = "product"
    extras: Extras = NOTHING

    def __post_init__(self) -> None:
        if not 1 <= self.k <= len(self.sizes):
            raise ValueError(f"k must be in [1, {len(self.sizes)}], got {self.k}")
        sums, most = (
            [sum(array.tolist()) for array in self.weight_arrays()],
            max([self.k, *(one.strength for one in self.extras.planes)]),
        )
        heaviest = sorted(sums, reverse=True)[:most]
        if self.combine == "product" and prod(heaviest) >= 1 << 63:
            weights = " × ".join(f"{weight:,}" for weight in heaviest)
            raise ValueError(
                f"k = {most}: the weights of a plane sum to {weights}, expected less than 2^63; choose a smaller k or weights"
            )

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of categories of each variable."""
        return self.constraints.sizes

    @property
    def mixed(self) -> Mixed:
        """What is combined."""
        return Mixed(self.k, self.extras)

    def counts(self) -> Counts:
        """Counts of no points yet, over its planes."""
        return (
            PlaneCounts(self.sizes, self.mixed) if self.extras else CellCounts(self.sizes, self.k)
        )

    def weights_of(self, planes: Iterable[tuple[int, ...]]) -> Iterator[Ints]:
        """The weights of the cells of some of its planes, feasible or not, shaped by the sizes of their variables."""
        arrays, single, of_extras = (
            self.weight_arrays(),
            self.extras.weights(),
            all_planes(len(self.sizes), self.mixed),
        )
        alike = [
            next(i for i, other in enumerate(arrays) if np.array_equal(own, other))
            for own in arrays
        ]

        @cache
        def combined(*chosen: int) -> Ints:
            """Planes of many variables are mostly alike, so each kind is combined once."""
            return np.asarray(
                reduce(_COMBINE[self.combine].outer, [arrays[variable] for variable in chosen])
            )

        for plane in planes:
            if of_extras[plane] is None:
                weights = combined(*(alike[variable] for variable in plane))
            else:
                weights = np.zeros([self.sizes[variable] for variable in plane], np.int64)
            if own := single.get(plane):
                weights = weights.copy()
                weights[tuple(np.transpose(list(own)))] = list(own.values())
            yield weights

    def weight_arrays(self) -> list[Ints]:
        """The weights of each variable's categories."""
        if self.weights is None:
            return [np.ones(size, dtype=np.int64) for size in self.sizes]
        arrays = [np.asarray(weight) for weight in self.weights]
        if [array.shape for array in arrays] != [(size,) for size in self.sizes]:
            raise ValueError(
                f"weights must have lengths {list(self.sizes)}, got {[array.shape for array in arrays]}"
            )
        for variable, array in enumerate(arrays):
            if (array < 0).any() or (array != np.floor(array)).any():
                raise ValueError(
                    f"weights of variable {variable} must be whole numbers from 0, got {array.tolist()}"
                )
            if self.combine == "product" and (array > HEAVIEST).any():
                raise ValueError(
                    f"weights of variable {variable} must be at most {HEAVIEST:,}, got {array.max():,}"
                )
        return [array.astype(np.int64) for array in arrays]


@dataclass(frozen=True)
class Coverage:
    """covered: sum of min(count, weight) over all cells. required: sum of the weights of the feasible cells, positive."""

    covered: int
    required: int

    @property
    def ratio(self) -> float:
        """In [0, 1]."""
        return self.covered / self.required


@dataclass(frozen=True)
class Plane:
    """One k-subset of variables. counts, wanted: points in each cell and its weight, 0 if no feasible point reaches it; shaped by the
    sizes."""

    variables: tuple[int, ...]
    counts: Ints
    wanted: Ints
    feasible: Bools

    @property
    def coverage(self) -> Coverage | None:
        """Coverage of this plane alone; None if its feasible cells want no points."""
        required = int(self.wanted.sum())
        return (
            Coverage(int(np.minimum(self.counts, self.wanted).sum()), required)
            if required
            else None
        )


def projection_coverage(categories: Ints, demand: Demand) -> Coverage:
    """Measure how far points meet a demand.

    categories: (n, d) category indices, n may be 0; a point with an unknown category, -1, is in no cell of the planes of that variable.

    Raises ValueError for an infeasible point, an index out of range, and if the feasible cells want no points at all.
    """
    check_points(categories, demand.constraints)
    counts = demand.counts()
    counts.add(categories)
    return total(planes(counts, demand))


def planes(counts: Counts, demand: Demand) -> Iterator[Plane]:
    """Every plane with its counts, weights and feasible cells. counts: over the planes of the demand."""
    constraints, every = demand.constraints, list(counts)
    for (chosen, cells), plane in zip(
        every, demand.weights_of(chosen for chosen, _ in every), strict=True
    ):
        feasible = np.ones(cells.shape, dtype=bool)
        if not constraints.named.isdisjoint(chosen):
            feasible = constraints.feasible_cells(chosen)
            plane = plane * feasible
        yield Plane(chosen, cells, plane, feasible)


def total(every: Iterable[Plane]) -> Coverage:
    """Coverage over all planes; ValueError if their feasible cells want no points at all."""
    covered = required = 0
    for plane in every:
        covered += int(np.minimum(plane.counts, plane.wanted).sum())
        required += int(plane.wanted.sum())
    if required == 0:
        raise ValueError("coverage is undefined: the weights of all feasible cells sum to 0")
    return Coverage(covered, required)


def check_points(categories: Ints, constraints: Constraints) -> None:
    """Raise ValueError for a wrong shape, an index out of range (-1 is unknown) or an infeasible point; the message names the first."""
    sizes = constraints.sizes
    if categories.ndim != 2 or categories.shape[1] != len(sizes):
        raise ValueError(f"categories must have shape (n, {len(sizes)}), got {categories.shape}")
    outside = (categories < -1) | (categories >= np.asarray(sizes))
    if outside.any():
        row, column = np.argwhere(outside)[0]
        raise ValueError(
            f"point {row}: category of variable {column} must be in [0, {sizes[column]}), got {categories[row, column]}"
        )
    if broken := constraints.first_broken(categories):
        count = int((~constraints.holds(categories)).sum())
        raise ValueError(
            f"{count} points break a constraint, the first is point {broken[0]}, which breaks clause {broken[1]}"
        )
