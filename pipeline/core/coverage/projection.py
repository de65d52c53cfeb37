"""Quantitative k-projection coverage (Cheng et al., Definition 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from math import prod
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pipeline.core.constraints import Constraints
from pipeline.core.space import Ints

Combine = Literal["product", "sum", "max"]
_COMBINE = {"product": np.multiply, "sum": np.add, "max": np.maximum}


@dataclass(frozen=True)
class Coverage:
    """covered: sum of min(count, weight) over all cells. required: sum of the weights of the feasible cells, positive."""

    covered: int
    required: int

    @property
    def ratio(self) -> float:
        """In [0, 1]."""
        return self.covered / self.required


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
    _check(categories, sizes, k, constraints)
    wanted = [np.ones(size, dtype=np.int64) for size in sizes] if weights is None else _checked_weights(weights, sizes)
    covered = required = 0
    for chosen in combinations(range(len(sizes)), k):
        plane = reduce(_COMBINE[combine].outer, (wanted[variable] for variable in chosen))
        if constraints is not None and constraints.clauses:
            plane = plane * constraints.feasible_cells(chosen)
        counts = cell_counts(categories, sizes, chosen)
        covered += int(np.minimum(counts, plane.ravel()).sum())
        required += int(plane.sum())
    if required == 0:
        raise ValueError("coverage is undefined: the weights of all feasible cells sum to 0")
    return Coverage(covered, required)


def cell_counts(categories: Ints, sizes: Sequence[int], chosen: Sequence[int]) -> Ints:
    """Number of points in each cell of the chosen variables, flat in C order, from (n, d) category indices."""
    keys = np.zeros(len(categories), dtype=np.int64)
    for variable in chosen:
        keys = keys * sizes[variable] + categories[:, variable]
    return np.bincount(keys, minlength=prod(sizes[variable] for variable in chosen))


def _check(categories: Ints, sizes: Sequence[int], k: int, constraints: Constraints | None) -> None:
    if not 1 <= k <= len(sizes):
        raise ValueError(f"k must be in [1, {len(sizes)}], got {k}")
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
    infeasible = np.flatnonzero(~constraints.holds(categories))
    if len(infeasible):
        raise ValueError(f"{len(infeasible)} points break a constraint, the first is point {infeasible[0]}")


def _checked_weights(weights: Sequence[ArrayLike], sizes: Sequence[int]) -> list[Ints]:
    arrays = [np.asarray(weight) for weight in weights]
    if [array.shape for array in arrays] != [(size,) for size in sizes]:
        raise ValueError(f"weights must have lengths {list(sizes)}, got {[array.shape for array in arrays]}")
    for variable, array in enumerate(arrays):
        if (array < 0).any() or (array != np.floor(array)).any():
            raise ValueError(f"weights of variable {variable} must be whole numbers from 0, got {array.tolist()}")
    return [array.astype(np.int64) for array in arrays]
