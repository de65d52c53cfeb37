"""Quantitative k-projection coverage (Cheng et al., Definition 4)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pipeline.core.constraints import Bools, Constraints
from pipeline.core.coverage.counting import CellCounts
from pipeline.core.space import Ints

Combine = Literal["product", "sum", "max"]
_COMBINE = {"product": np.multiply, "sum": np.add, "max": np.maximum}

HEAVIEST = 1000
"""Largest weight of a category: products over six conditions still are exact."""


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
    """One k-subset of conditions. counts, wanted: points in each cell and its weight, 0 where no feasible point is; sizes as shape."""

    conditions: tuple[int, ...]
    counts: Ints
    wanted: Ints
    feasible: Bools

    @property
    def coverage(self) -> Coverage | None:
        """Of this plane alone; None if its feasible cells want no points."""
        required = int(self.wanted.sum())
        return Coverage(int(np.minimum(self.counts, self.wanted).sum()), required) if required else None


def projection_coverage(
    categories: Ints,
    sizes: Sequence[int],
    k: int,
    *,
    weights: Sequence[ArrayLike] | None = None,
    combine: Combine = "product",
    constraints: Constraints | None = None,
) -> Coverage:
    """How well points cover every combination of categories of every k of the variables.

    categories: (n, d) category indices, n may be 0. sizes: number of categories of each variable. k: 1 to d.
    weights: for each variable its (size,) whole numbers of points wanted, 1 each if not given; a cell wants the product, sum or
    maximum of those of its categories. Only cells that a feasible point reaches count.

    Raises ValueError for an infeasible point, an index out of range, and if the feasible cells want no points at all.
    """
    check_points(categories, sizes, constraints)
    counts = CellCounts(sizes, k)
    counts.add(categories)
    return total(planes(counts, weights=weights, combine=combine, constraints=constraints))


def planes(
    counts: CellCounts,
    *,
    weights: Sequence[ArrayLike] | None = None,
    combine: Combine = "product",
    constraints: Constraints | None = None,
) -> Iterator[Plane]:
    """Every plane with its counts, weights and feasible cells; see `projection_coverage`."""
    sizes = counts.sizes
    wanted = [np.ones(size, dtype=np.int64) for size in sizes] if weights is None else _checked_weights(weights, sizes)
    for chosen, cells in counts:
        plane = reduce(_COMBINE[combine].outer, (wanted[variable] for variable in chosen))
        feasible = np.ones(cells.shape, dtype=bool)
        if constraints is not None and not constraints.named.isdisjoint(chosen):
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


def check_points(categories: Ints, sizes: Sequence[int], constraints: Constraints | None = None) -> None:
    """Raise ValueError for a wrong shape, an index out of range or an infeasible point, naming the first such point."""
    if categories.ndim != 2 or categories.shape[1] != len(sizes):
        raise ValueError(f"categories must have shape (n, {len(sizes)}), got {categories.shape}")
    outside = (categories < 0) | (categories >= np.asarray(sizes))
    if outside.any():
        row, column = np.argwhere(outside)[0]
        raise ValueError(f"point {row}: category of variable {column} must be in [0, {sizes[column]}), got {categories[row, column]}")
    if constraints is None:
        return
    if constraints.sizes != tuple(sizes):
        raise ValueError(f"constraints are over sizes {constraints.sizes}, the points over {tuple(sizes)}")
    if broken := constraints.first_broken(categories):
        count = int((~constraints.holds(categories)).sum())
        raise ValueError(f"{count} points break a constraint, the first is point {broken[0]}, which breaks clause {broken[1]}")


def _checked_weights(weights: Sequence[ArrayLike], sizes: Sequence[int]) -> list[Ints]:
    arrays = [np.asarray(weight) for weight in weights]
    if [array.shape for array in arrays] != [(size,) for size in sizes]:
        raise ValueError(f"weights must have lengths {list(sizes)}, got {[array.shape for array in arrays]}")
    for variable, array in enumerate(arrays):
        if (array < 0).any() or (array != np.floor(array)).any():
            raise ValueError(f"weights of variable {variable} must be whole numbers from 0, got {array.tolist()}")
        if (array > HEAVIEST).any():
            raise ValueError(f"weights of variable {variable} must be at most {HEAVIEST:,}, got {array.max():,}")
    return [array.astype(np.int64) for array in arrays]
