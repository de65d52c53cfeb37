"""Known constructions of arrays, as starts for the search.

Full factorials, orthogonal arrays, cyclic arrays and doubling.
"""

from __future__ import annotations

from itertools import count, takewhile

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.coverage.fields import galois_field

Int32s = NDArray[np.int32]
FREE = -1
"""A cell of a row that may take any category."""
STARTER_STEPS = 400_000
"""Steps of the search for the row of a cyclic array."""
OF_TWELVE = (
    (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11),
    (0, 2, 1, 6, 8, 7, 10, 9, 11, 4, 3, 5),
    (0, 3, 8, 10, 1, 9, 2, 6, 5, 7, 11, 4),
    (0, 4, 10, 9, 7, 1, 11, 5, 3, 2, 8, 6),
    (0, 8, 6, 4, 3, 10, 9, 11, 2, 5, 1, 7),
)
"""Permutations of Z2 x Z6, where 6 x + y is (x, y) (Johnson, Dulmage and Mendelsohn 1961)."""


def factorial(sizes: tuple[int, ...]) -> Int32s | None:
    """Every pair of the two largest variables once.

    The other variables follow from a difference matrix if that covers all pairs; else they are
    free. With B categories of the second largest, a row (a, b) gets b + m(a mod B) in another
    variable, where m is its row of the matrix. The first B categories of the largest give an
    orthogonal array, so every pair is covered (Bose and Bush 1952).

    Args:
        sizes: number of categories of each variable.

    Returns:
        (rows, d) categories; `FREE` beyond a variable's size. None for a single variable.

    >>> factorial((2, 2, 2)).tolist()
    [[0, 0, 0], [0, 1, 1], [1, 0, 1], [1, 1, 0]]
    """
    if len(sizes) < 2:
        return None
    largest, second, *others = sorted(range(len(sizes)), key=lambda variable: -sizes[variable])
    order = sizes[second]
    a, b = (axis.ravel() for axis in np.indices((sizes[largest], order)))
    rows = np.full((len(a), len(sizes)), FREE, dtype=np.int32)
    rows[:, largest], rows[:, second] = a, b
    # The sums of a group, and permutations of it whose differences are permutations.
    if arithmetic := galois_field(order):
        add, matrix = arithmetic.add, arithmetic.times[1:]
    else:
        halves, sixths = np.divmod(np.arange(order), 6)
        add = (halves[:, None] + halves) % 2 * 6 + (sixths[:, None] + sixths) % 6
        matrix = np.array(OF_TWELVE if order == 12 else [], np.int64).reshape(-1, order)
    if len(others) <= len(matrix):
        for of, variable in zip(matrix, others, strict=False):
            values = add[b, of[a % order]]
            rows[:, variable] = np.where(values < sizes[variable], values, FREE)
    return rows


def orthogonal(sizes: tuple[int, ...], strength: int, at_most: int) -> Int32s | None:
    """An orthogonal array of the smallest order with enough columns (Bush 1952).

    Rows are the polynomials of degree below the strength over a finite field. Columns are their
    values at each element, and the leading coefficient. Strength 3 over a field of even order has
    one more column, the middle coefficient.

    Args:
        sizes: number of categories of each variable.
        strength: t, at least 1.
        at_most: largest number of rows of interest.

    Returns:
        (rows, d) categories; `FREE` beyond a variable's size. None if no order is suitable.

    >>> orthogonal((3, 3, 3, 3), strength=2, at_most=9).shape
    (9, 4)
    """
    for order in takewhile(lambda order: order**strength <= at_most, count(max(*sizes, strength))):
        columns = order + 2 if strength == 3 and order % 2 == 0 else order + 1
        if len(sizes) <= columns and (arithmetic := galois_field(order)) is not None:
            coefficients = np.indices((order,) * strength).reshape(strength, -1)
            values = np.repeat(coefficients[:1], order, axis=0)
            for lower in coefficients[1:]:
                values = arithmetic.add[arithmetic.times[values, np.arange(order)[:, None]], lower]
            leading, middle = coefficients[0], coefficients[min(1, strength - 1)]
            rows = np.vstack([values, leading, middle]).T[:, : len(sizes)]
            free = np.where(rows < sizes, rows, FREE).astype(np.int32)
            return np.unique(free[(free != FREE).any(axis=1)], axis=0)
    return None


def doubled(three: Int32s, two: Int32s, sizes: tuple[int, ...]) -> Int32s:
    """An array of strength 3 from arrays for half of the columns (Chateauneuf and Kreher 2002).

    Args:
        three: (rows, half) array of strength 3 for the first half of the sizes, rounded up.
        two: (rows, half) array of strength 2 for the same columns.
        sizes: categories of all columns, largest first; column i of the second half belongs to
            column i of the first, which is at least as large.

    Returns:
        (rows, d) categories; `FREE` beyond a column's size.
    """
    half, largest = three.shape[1], sizes[0]
    first, second = np.array(sizes[:half]), len(sizes) - half
    blocks = [np.hstack([three, three[:, :second]])]
    blocks += [np.hstack([two, ((two + shift) % first)[:, :second]]) for shift in range(1, largest)]
    rows = np.vstack(blocks)
    return np.where(rows < np.array(sizes), rows, FREE).astype(np.int32)


def cyclic(sizes: tuple[int, ...], fewer_than: int, seed: int) -> Int32s | None:
    """A cyclic array of k (v - 1) + 1 rows for k columns of v categories.

    Its rows are the rotations of one row, each with v - 1 shifts, and a constant row (Meagher and
    Stevens 2005).

    Args:
        sizes: number of categories of each column.
        fewer_than: the array must have fewer rows.
        seed: seed of the search for the first row.

    Returns:
        (rows, k) categories; None if the sizes differ, the array is too large or the search fails.

    >>> cyclic((3, 3, 3, 3, 3), fewer_than=12, seed=0).shape
    (11, 5)
    """
    columns, categories = len(sizes), max(sizes)
    if min(sizes) != categories or categories < 3 or columns * (categories - 1) + 1 >= fewer_than:
        return None
    starter = _cyclic_starter(columns, categories, STARTER_STEPS, seed)
    if starter[0] < 0:
        return None
    last = categories - 1
    rotated = np.array([np.roll(starter, -shift) for shift in range(columns)])
    blocks = [np.where(rotated == last, rotated, (rotated + by) % last) for by in range(last)]
    return np.vstack([*blocks, np.full((1, columns), last)]).astype(np.int32)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _cyclic_starter(columns: int, categories: int, steps: int, seed: int) -> Int32s:
    """A row (columns,) whose rotations and shifts cover all pairs beside a constant row.

    Shifts are modulo categories - 1 and keep the last category. For every distance d between
    columns, the differences of the entries d apart must take every value, and the last category
    must occur before and after other categories. The row is -1 if the search fails.
    """
    np.random.seed(seed)
    last, half = categories - 1, columns // 2
    row = np.random.randint(0, categories, columns).astype(np.int32)
    # seen[d, x]: pairs at distance d + 1 with difference x; x = last: the last category comes
    # first; x = last + 1: it comes second.
    seen = np.zeros((half, last + 2), np.int32)
    for d in range(half):
        for i in range(columns):
            _count(seen, d, row[i], row[(i + d + 1) % columns], 1)
    missing = (seen == 0).sum()
    for step in range(steps):
        if missing == 0:
            return row
        temperature = 0.6 * (1 - step / steps) + 0.1
        at, value = np.random.randint(columns), np.random.randint(categories)
        old = row[at]
        if value == old:
            continue
        before = missing
        missing += _exchange(seen, row, at, value)
        if missing > before and np.random.random() >= np.exp((before - missing) / temperature):
            missing += _exchange(seen, row, at, old)
    return np.full(columns, -1, np.int32) if missing else row


@njit(cache=True)  # type: ignore[untyped-decorator]
def _exchange(seen: Int32s, row: Int32s, at: int, value: int) -> int:
    """Put a value into the row; returns the change in the number of unseen classes."""
    change, half, columns = 0, len(seen), len(row)
    for d in range(half):
        after, before = (at + d + 1) % columns, (at - d - 1) % columns
        change += _count(seen, d, row[at], row[after], -1)
        change += _count(seen, d, row[before], row[at], -1)
    row[at] = value
    for d in range(half):
        after, before = (at + d + 1) % columns, (at - d - 1) % columns
        change += _count(seen, d, row[at], row[after], 1)
        change += _count(seen, d, row[before], row[at], 1)
    return change


@njit(cache=True)  # type: ignore[untyped-decorator]
def _count(seen: Int32s, d: int, a: int, b: int, by: int) -> int:
    """Count a pair of categories at distance d + 1; returns the change in unseen classes."""
    last = seen.shape[1] - 2
    if a == last and b == last:
        return 0
    kind = (b - a) % last
    if a == last:
        kind = last
    elif b == last:
        kind = last + 1
    seen[d, kind] += by
    if by > 0:
        return -1 if seen[d, kind] == 1 else 0
    return 1 if seen[d, kind] == 0 else 0
