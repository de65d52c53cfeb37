"""Covering arrays of strength three and more for many columns, from covering perfect hash families.

A column of a family has a vector over a finite field in each of its rows, and any t columns have
independent vectors in some row. The products of all messages with the vectors of such a row hold
every cell of these columns (Sherwood, Martirosyan and Colbourn 2006).
"""

from __future__ import annotations

from itertools import combinations
from math import comb, prod

import numpy as np
from numba import njit

from pipeline.core.coverage.constructions import FREE, Int32s
from pipeline.core.coverage.fields import Field, galois_field
from pipeline.core.space import Ints

DETERMINANTS = 3_000_000
"""Sets of columns that one attempt to find a family examines."""
ATTEMPTS = 3
TEMPERATURES = (0.8, 0.2)
"""First and last, in sets of columns without independent vectors."""
MOST_DEPENDENT = 120
"""Most sets of columns without independent vectors in a random family that is worth a search: no
search succeeded from 130."""


def from_hash_family(
    sizes: tuple[int, ...], strength: int, fewer_than: int, seed: int
) -> Int32s | None:
    """An array from the family with the fewest rows that the search finds.

    A family of n rows over a field of q elements gives n (q^t - q) + q rows if each vector begins
    with one, else at most n (q^t - 1) + 1.

    Args:
        sizes: number of categories of each variable.
        strength: t, at least 3.
        fewer_than: the array must have fewer rows.
        seed: seed of the search.

    Returns:
        (rows, d) categories; `FREE` beyond a variable's size. None if no family is small enough.

    >>> from_hash_family((2,) * 7, strength=3, fewer_than=25, seed=1).shape
    (15, 7)
    """
    order = max(*sizes, 2)
    while (arithmetic := galois_field(order)) is None:
        order += 1
    best = None
    for number in range((fewer_than - 1 - order) // (order**strength - order), 1, -1):
        family = searched(arithmetic, (number, len(sizes), strength), seed)
        if family is None and (number, strength) == (2, 3) and len(sizes) <= order**2 + order + 1:
            family = opposed(arithmetic, len(sizes))
        if family is None:
            break
        best = family
    if best is None:
        return None
    rows = products(arithmetic, best)
    free = np.where(rows < sizes, rows, FREE).astype(np.int32)
    return np.unique(free[(free != FREE).any(axis=1)], axis=0)


def products(arithmetic: Field, family: Ints) -> Ints:
    """The products of every message with the vectors of each row of a family.

    Args:
        arithmetic: the field of q elements.
        family: (n, columns, t) vectors.

    Returns:
        (rows, columns), each row once.
    """
    order, strength = len(arithmetic.add), family.shape[2]
    messages, blocks = np.indices((order,) * strength).reshape(strength, -1), []
    for vectors in family:
        values = np.zeros((order**strength, len(vectors)), np.int64)
        for message, coordinate in zip(messages, vectors.T, strict=True):
            values = arithmetic.add[values, arithmetic.times[message[:, None], coordinate]]
        blocks.append(values)
    return np.unique(np.vstack(blocks), axis=0)


def opposed(arithmetic: Field, columns: int) -> Ints:
    """A family of two rows of strength 3 for up to q^2 + q + 1 columns.

    The rows are the powers 0, 1, 2, ... and 0, -1, -2, ... of a generator of the plane's points.
    Three powers on a line have inverses on an oval, so these are not on a line (Raaphorst, Moura
    and Stevens 2014).

    Returns:
        (2, columns, 3) vectors.
    """
    powers = _powers(arithmetic)
    return np.stack([powers[:columns], np.roll(powers[::-1], 1, axis=0)[:columns]])


def _powers(arithmetic: Field) -> Ints:
    """The points of the projective plane in the order of a generator, (q^2 + q + 1, 3)."""
    add, times, order = arithmetic.add, arithmetic.times, len(arithmetic.add)
    number, inverse = order**2 + order + 1, (arithmetic.times == 1).argmax(axis=1)
    # The first coefficient of the recurrence is not zero.
    for recurrence in np.indices((order,) * 3).reshape(3, -1).T[order**2 :]:
        powers = [np.array([0, 0, 1])]
        while len(powers) < number:
            a, b, c = times[recurrence, powers[-1]]
            powers.append(np.array([*powers[-1][1:], add[add[a, b], c]]))
        vectors = np.array(powers)
        leading = vectors[np.arange(number), (vectors != 0).argmax(axis=1)]
        points = times[inverse[leading][:, None], vectors]
        if len(np.unique(points[(vectors != 0).any(axis=1)], axis=0)) == number:
            return vectors
    raise AssertionError("every finite field has an extension of degree three")


def searched(arithmetic: Field, shape: tuple[int, int, int], seed: int) -> Ints | None:
    """Search for a family by simulated annealing; each vector begins with one.

    Args:
        arithmetic: the field.
        shape: rows, columns and t of the family.
        seed: seed of all random draws.

    Returns:
        (rows, columns, t) vectors; None if the search fails or has no chance.
    """
    number, columns, strength = shape
    dependent = 1 - prod(1 - len(arithmetic.add) ** -power for power in range(1, strength))
    if comb(columns, strength) * dependent**number > MOST_DEPENDENT:
        return None
    subsets = np.array(list(combinations(range(columns), strength)))
    sets_of = [np.flatnonzero((subsets == column).any(axis=1)) for column in range(columns)]
    of_column = np.array(sets_of)
    order, rng = len(arithmetic.add), np.random.default_rng(seed)
    subtract = (arithmetic.add == np.arange(order)[:, None, None]).argmax(axis=2)
    tables = (subtract, arithmetic.times, (arithmetic.times == 1).argmax(axis=1))
    plan = (DETERMINANTS // of_column.shape[1], *TEMPERATURES)
    for _ in range(ATTEMPTS):
        family = rng.integers(0, order, shape)
        family[:, :, 0] = 1
        if _anneal(family, subsets, of_column, tables, plan, int(rng.integers(2**31))):
            return family
    return None


Tables = tuple[Ints, Ints, Ints]
"""Differences and products of a field's elements, (q, q), and their inverses, (q,)."""


@njit(cache=True)  # type: ignore[untyped-decorator]
def _anneal(
    family: Ints,
    subsets: Ints,
    of_column: Ints,
    field: Tables,
    plan: tuple[int, float, float],
    seed: int,
) -> bool:
    """Change single vectors in place until any t columns are independent in some row.

    subsets: (sets, t) columns. of_column: the sets of each column. plan: number of steps, first and
    last temperature. Returns whether it succeeds.
    """
    np.random.seed(seed)
    steps, temperature, cold = plan
    factor, strength = (cold / temperature) ** (1.0 / max(1, steps)), subsets.shape[1]
    independent = np.zeros((len(family), len(subsets)), np.int64)
    for r in range(len(family)):
        for s in range(len(subsets)):
            independent[r, s] = _independent(family[r][subsets[s]], field)
    counts = independent.sum(axis=0)
    for _ in range(steps):
        lacking = np.flatnonzero(counts == 0)
        if len(lacking) == 0:
            break
        temperature *= factor
        r = np.random.randint(len(family))
        column = subsets[lacking[np.random.randint(len(lacking))], np.random.randint(strength)]
        sets, old = of_column[column], family[r, column].copy()
        family[r, column, 1:] = np.random.randint(0, len(field[0]), strength - 1)
        change = np.empty(len(sets), np.int64)
        for i, s in enumerate(sets):
            change[i] = _independent(family[r][subsets[s]], field) - independent[r, s]
        more = ((counts[sets] + change == 0).sum()) - (counts[sets] == 0).sum()
        if more <= 0 or np.random.random() < np.exp(-more / temperature):
            independent[r][sets] += change
            counts[sets] += change
        else:
            family[r, column] = old
    return bool(counts.min() > 0)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _independent(vectors: Ints, field: Tables) -> bool:
    """Whether the rows of a square matrix are independent, by elimination; changes the matrix."""
    subtract, times, inverse = field
    for column in range(len(vectors)):
        pivot = column
        while pivot < len(vectors) and vectors[pivot, column] == 0:
            pivot += 1
        if pivot == len(vectors):
            return False
        for i in range(len(vectors)):  # Exchanges the two rows.
            vectors[column, i], vectors[pivot, i] = vectors[pivot, i], vectors[column, i]
        for row in range(column + 1, len(vectors)):
            if vectors[row, column]:
                factor = times[vectors[row, column], inverse[vectors[column, column]]]
                for i in range(column, len(vectors)):
                    product = times[factor, vectors[column, i]]
                    vectors[row, i] = subtract[vectors[row, i], product]
    return True
