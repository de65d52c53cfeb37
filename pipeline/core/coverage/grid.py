"""The cells and clauses of a problem, as arrays for the kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.constraints import Bools
from pipeline.core.space import Ints

Int32s = NDArray[np.int32]
Move = tuple[int, int]
"""A column and its required category."""


class Clauses(NamedTuple):
    """The constraints of a problem.

    `of[start[c]:start[c + 1]]` are the clauses that name column c. The literals of a clause start
    at literal_start[clause]: a column, a category, and whether the two must be equal.
    """

    start: Int32s
    of: Int32s
    literal_start: Int32s
    column: Int32s
    category: Int32s
    equal: Bools


class Lines(NamedTuple):
    """The cells that a column's categories reach.

    For column c and its q-th plane: base[c, q] is that plane's first cell, step[c, q] the stride
    of the column, other[c, q] and other_step[c, q] the plane's other columns and their strides.
    """

    base: Int32s
    step: Int32s
    other: Int32s
    other_step: Int32s


class Grid(NamedTuple):
    """The cells of a problem.

    sizes: (n,) categories of each column.
    planes: (planes, t) columns.
    first: (planes,) first cell of each plane.
    stride: (planes, t) step of each of its columns.
    """

    sizes: Int32s
    planes: Int32s
    first: Ints
    stride: Int32s
    lines: Lines
    clauses: Clauses


@njit(cache=True)  # type: ignore[untyped-decorator]
def line_of(lines: Lines, row: Int32s, column: int, q: int) -> int:
    """The row's cell in the column's q-th plane if the column had category 0.

    The cells of the column's other categories follow at the column's step.
    """
    base, _, other, other_step = lines
    cell = base[column, q]
    for x in range(other.shape[2]):
        cell += row[other[column, q, x]] * other_step[column, q, x]
    return int(cell)
