"""Quantitative k-projection coverage (Cheng et al., Definition 4)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
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
    """What full coverage wants: points in every cell of every k variables that is feasible.

    Args:
        constraints: what is feasible, over all d variables.
        k: variables of a plane, in [1, d].
        weights: for each variable its (size,) whole numbers of wanted points, 1 each by default.
        combine: how the weight of a cell follows from those of its categories.
        extras: more planes, and weights of single cells.

    Raises:
        ValueError: if k or a weight is out of range, or weights are too heavy together.

    >>> demand = Demand(Constraints((2, 3)), k=2, weights=[[1, 2], [1, 1, 3]])
    >>> next(demand.weights_of([(0, 1)])).tolist()
    [[1, 1, 3], [2, 2, 6]]
    """

    constraints: Constraints
    k: int
    weights: Sequence[ArrayLike] | None = None
    combine: Combine = "product"
    extras: Extras = NOTHING

    def __post_init__(self) -> None:
        if not 1 <= self.k <= len(self.sizes):
            raise ValueError(f"k must be in [1, {len(self.sizes)}], got {self.k}")
        sums = [sum(array.tolist()) for array in self.weight_arrays()]
        most = max([self.k, *(named.strength for named in self.extras.planes)])
        heaviest = sorted(sums, reverse=True)[:most]
        if self.combine == "product" and prod(heaviest) >= 1 << 63:
            weights = " × ".join(f"{weight:,}" for weight in heaviest)
            raise ValueError(
                f"k = {most}: the weights of a plane sum to {weights}, expected less than 2^63;"
                " choose a smaller k or weights"
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
        if self.extras:
            return PlaneCounts(self.sizes, self.mixed)
        return CellCounts(self.sizes, self.k)

    def weights_of(self, planes: Iterable[tuple[int, ...]]) -> Iterator[Ints]:
        """The weights of the cells of some of its planes, feasible or not.

        Yields:
            For each plane an array in the shape of its variables' sizes.
        """
        arrays, single = self.weight_arrays(), self.extras.weights()
        of_extras = all_planes(len(self.sizes), self.mixed)
        # Planes of many variables are mostly alike, so each kind is combined once.
        first_alike: dict[tuple[int, ...], int] = {}
        for variable, array in enumerate(arrays):
            first_alike.setdefault(tuple(array.tolist()), variable)
        alike = [first_alike[tuple(array.tolist())] for array in arrays]
        combined: dict[tuple[int, ...], Ints] = {}
        for plane in planes:
            kind = tuple(alike[variable] for variable in plane)
            if of_extras[plane] is not None:
                weights = np.zeros([self.sizes[variable] for variable in plane], np.int64)
            else:
                if kind not in combined:
                    outer = _COMBINE[self.combine].outer
                    combined[kind] = np.asarray(reduce(outer, [arrays[v] for v in kind]))
                weights = combined[kind]
            if cells := single.get(plane):
                weights = weights.copy()
                weights[tuple(np.transpose(list(cells)))] = list(cells.values())
            yield weights

    def weight_arrays(self) -> list[Ints]:
        """The weights of each variable's categories."""
        if self.weights is None:
            return [np.ones(size, dtype=np.int64) for size in self.sizes]
        arrays = [np.asarray(weight) for weight in self.weights]
        shapes = [array.shape for array in arrays]
        if shapes != [(size,) for size in self.sizes]:
            raise ValueError(f"weights must have lengths {list(self.sizes)}, got {shapes}")
        for variable, array in enumerate(arrays):
            name = f"weights of variable {variable}"
            if (array < 0).any() or (array != np.floor(array)).any():
                raise ValueError(f"{name} must be whole numbers from 0, got {array.tolist()}")
            if self.combine == "product" and (array > HEAVIEST).any():
                raise ValueError(f"{name} must be at most {HEAVIEST:,}, got {array.max():,}")
        return [array.astype(np.int64) for array in arrays]


@dataclass(frozen=True)
class Coverage:
    """Quantitative coverage (Cheng et al., Definition 4).

    Attributes:
        covered: sum of min(count, weight) over all cells.
        required: sum of the weights of the feasible cells, > 0.
    """

    covered: int
    required: int

    @property
    def ratio(self) -> float:
        """Covered share, in [0, 1]."""
        return self.covered / self.required


@dataclass(frozen=True)
class Plane:
    """One k-subset of variables; all arrays have the shape of the variables' sizes.

    Attributes:
        variables: rising.
        counts: points in each cell.
        wanted: weight of each cell, 0 if no feasible point reaches it.
        feasible: whether some feasible point reaches the cell.
    """

    variables: tuple[int, ...]
    counts: Ints
    wanted: Ints
    feasible: Bools

    @property
    def coverage(self) -> Coverage | None:
        """Coverage of this plane alone; None if its feasible cells want no points."""
        if not (required := int(self.wanted.sum())):
            return None
        return Coverage(int(np.minimum(self.counts, self.wanted).sum()), required)


def projection_coverage(categories: Ints, demand: Demand) -> Coverage:
    """Measure how far points meet a demand (Cheng et al., Definition 4).

    Args:
        categories: (n, d) category indices, n may be 0. A point with an unknown category, -1, is
            in no cell of the planes of that variable.
        demand: what full coverage wants.

    Raises:
        ValueError: for an infeasible point, for an index out of range, and if the feasible cells
            want no points at all.

    >>> demand = Demand(Constraints((2, 2, 2)), k=2)
    >>> projection_coverage(np.array([[0, 0, 0], [1, 1, 1]]), demand)
    Coverage(covered=6, required=12)
    """
    check_points(categories, demand.constraints)
    counts = demand.counts()
    counts.add(categories)
    return total(planes(counts, demand))


def planes(counts: Counts, demand: Demand) -> Iterator[Plane]:
    """Yield every plane with its counts, weights and feasible cells.

    Args:
        counts: of the points, over the planes of the demand.
        demand: what full coverage wants.
    """
    constraints, every = demand.constraints, list(counts)
    weights = demand.weights_of(variables for variables, _ in every)
    for (variables, cells), wanted in zip(every, weights, strict=True):
        feasible = np.ones(cells.shape, dtype=bool)
        if not constraints.named.isdisjoint(variables):
            feasible = constraints.feasible_cells(variables)
            wanted = wanted * feasible
        yield Plane(variables, cells, wanted, feasible)


def total(every: Iterable[Plane]) -> Coverage:
    """Coverage over all planes.

    Raises:
        ValueError: if their feasible cells want no points at all.
    """
    covered = required = 0
    for plane in every:
        covered += int(np.minimum(plane.counts, plane.wanted).sum())
        required += int(plane.wanted.sum())
    if required == 0:
        raise ValueError("coverage is undefined: the weights of all feasible cells sum to 0")
    return Coverage(covered, required)


def check_points(categories: Ints, constraints: Constraints) -> None:
    """Check the shape, the range and the feasibility of points.

    Args:
        categories: (n, d) category indices, -1 for unknown.
        constraints: over the d variables.

    Raises:
        ValueError: names the first wrong point.
    """
    sizes = constraints.sizes
    if categories.ndim != 2 or categories.shape[1] != len(sizes):
        raise ValueError(f"categories must have shape (n, {len(sizes)}), got {categories.shape}")
    outside = (categories < -1) | (categories >= np.asarray(sizes))
    if outside.any():
        row, column = np.argwhere(outside)[0]
        raise ValueError(
            f"point {row}: category of variable {column} must be in [0, {sizes[column]}),"
            f" got {categories[row, column]}"
        )
    if broken := constraints.first_broken(categories):
        count = int((~constraints.holds(categories)).sum())
        raise ValueError(
            f"{count} points break a constraint, the first is point {broken[0]}, which breaks"
            f" clause {broken[1]}"
        )
