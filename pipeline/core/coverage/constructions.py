"""Known constructions of arrays, as starts for the search: full factorials, orthogonal arrays, cyclic arrays, doubling."""

from __future__ import annotations

from itertools import count, takewhile

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.coverage.fields import Field, galois_field
from pipeline.core.space import Ints

Int32s = NDArray[np.int32]
FREE = -1
"""A cell of a row that may take any category."""
STARTER_STEPS = 400_000


def factorial(sizes: tuple[int, ...]) -> Int32s | None:
    """Every pair of the two largest variables once; the others by a linear rule if that covers all pairs, else free.

    With B categories of the second largest, B prime, a row (a, b) gets (b + m a) mod B in the m-th other variable. Two different m give an
    orthogonal array, so every pair is covered (Bose 1938); values beyond a variable's size stay free.
    """
    if len(sizes) < 2:
        return None
    largest, second, *others = sorted(range(len(sizes)), key=lambda variable: -sizes[variable])
    a, b = (axis.ravel() for axis in np.indices((sizes[largest], sizes[second])))
    rows = np.full((len(a), len(sizes)), FREE, dtype=np.int32)
    rows[:, largest], rows[:, second] = a, b
    if len(others) < sizes[second] and _is_prime(sizes[second]):
        for multiplier, variable in enumerate(others, start=1):
            values = (b + multiplier * a) % sizes[second]
            rows[:, variable] = np.where(values < sizes[variable], values, FREE)
    return rows


def orthogonal(sizes: tuple[int, ...], strength: int, at_most: int) -> Int32s | None:
    """An orthogonal array of the smallest order with enough columns, values beyond a variable's size free (Bush 1952).

    Rows are the polynomials of degree below the strength over a finite field; columns are their values at each element, and the leading
    coefficient. Strength 3 over a field of even order has one more column, the middle coefficient. at_most: rows. None if no order will do.
    """
    for order in takewhile(lambda order: order**strength <= at_most, count(max(*sizes, strength))):
        columns = order + 2 if strength == 3 and order % 2 == 0 else order + 1
        if len(sizes) <= columns and (arithmetic := galois_field(order)) is not None:
            rows = _polynomials(arithmetic, strength)[:, : len(sizes)]
            free = np.where(rows < sizes, rows, FREE).astype(np.int32)
            return np.unique(free[(free != FREE).any(axis=1)], axis=0)
    return None


def _polynomials(arithmetic: Field, strength: int) -> Ints:
    """The values of every polynomial at every element, then its leading and its middle coefficient."""
    order = len(arithmetic.add)
    coefficients = np.indices((order,) * strength).reshape(strength, -1)
    values = np.repeat(coefficients[:1], order, axis=0)
    for lower in coefficients[1:]:
        values = arithmetic.add[arithmetic.times[values, np.arange(order)[:, None]], lower]
    return np.vstack([values, coefficients[0], coefficients[min(1, strength - 1)]]).T


def doubled(three: Int32s, two: Int32s, sizes: tuple[int, ...]) -> Int32s:
    """An array of strength 3 for the given sizes from arrays of strengths 3 and 2 for the first half of them (Chateauneuf and Kreher 2002).

    sizes: largest first; column i of the second half belongs to column i of the first, whose size is at least its own.
    """
    half, largest = three.shape[1], sizes[0]
    first, second = np.array(sizes[:half]), len(sizes) - half
    blocks = [np.hstack([three, three[:, :second]])]
    blocks += [np.hstack([two, ((two + shift) % first)[:, :second]]) for shift in range(1, largest)]
    rows = np.vstack(blocks)
    return np.where(rows < np.array(sizes), rows, FREE).astype(np.int32)


def cyclic(sizes: tuple[int, ...], fewer_than: int, seed: int) -> Int32s | None:
    """A cyclic array of k (v - 1) + 1 rows for k columns of v categories: the rotations of one row, each with v - 1 shifts, and a constant
    row.

    None if it is not smaller than the given limit, or no such row is found (Meagher and Stevens 2005).
    """
    columns, categories = len(sizes), max(sizes)
    if min(sizes) != categories or categories < 3 or columns * (categories - 1) + 1 >= fewer_than:
        return None
    starter = _cyclic_starter(columns, categories, STARTER_STEPS, seed)
    if starter[0] < 0:
        return None
    rotated = np.array([np.roll(starter, -shift) for shift in range(columns)])
    shifted = [np.where(rotated == categories - 1, rotated, (rotated + by) % (categories - 1)) for by in range(categories - 1)]
    return np.vstack([*shifted, np.full((1, columns), categories - 1)]).astype(np.int32)


def _is_prime(number: int) -> bool:
    return number > 1 and all(number % divisor for divisor in range(2, int(number**0.5) + 1))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _cyclic_starter(columns: int, categories: int, steps: int, seed: int) -> Int32s:
    """A row (columns,) with rotations that, shifted modulo categories - 1, cover all pairs together with a constant row; -1 if none is
    found.

    Shifts keep the last category. For every distance d between columns, the differences of the entries d apart must take every value, and
    the last category must occur before and after other categories.
    """
    np.random.seed(seed)
    last, half = categories - 1, columns // 2
    row = np.random.randint(0, categories, columns).astype(np.int32)
    # seen[d, x]: pairs at distance d + 1 with difference x; x = last: the last category comes first; x = last + 1: it comes second.
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
        change += _count(seen, d, row[at], row[after], -1) + _count(seen, d, row[before], row[at], -1)
    row[at] = value
    for d in range(half):
        after, before = (at + d + 1) % columns, (at - d - 1) % columns
        change += _count(seen, d, row[at], row[after], 1) + _count(seen, d, row[before], row[at], 1)
    return change


@njit(cache=True)  # type: ignore[untyped-decorator]
def _count(seen: Int32s, d: int, a: int, b: int, by: int) -> int:
    """Count a pair of categories at distance d + 1; returns the change in the number of unseen classes."""
    last = seen.shape[1] - 2
    if a == last and b == last:
        return 0
    kind = last if a == last else last + 1 if b == last else (b - a) % last
    seen[d, kind] += by
    if by > 0:
        return -1 if seen[d, kind] == 1 else 0
    return 1 if seen[d, kind] == 0 else 0
