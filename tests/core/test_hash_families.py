"""Covering arrays from hash families: all combinations of any t columns, and published sizes."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from pipeline.core.constraints import Constraints
from pipeline.core.coverage import hash_families
from pipeline.core.coverage.arrays import covering_array
from pipeline.core.coverage.constructions import FREE
from pipeline.core.coverage.fields import galois_field
from pipeline.core.coverage.hash_families import from_hash_family, opposed, products, searched
from pipeline.core.coverage.problem import of_strength
from pipeline.core.coverage.search import Search
from pipeline.core.coverage.verification import verify


@pytest.mark.parametrize("order", [2, 3, 4, 5])
def test_opposed_powers_reach_the_published_size(order: int) -> None:
    """2 q^3 - 1 rows for q^2 + q + 1 columns (Raaphorst, Moura and Stevens 2014)."""
    arithmetic, columns = galois_field(order), order**2 + order + 1
    assert arithmetic is not None
    rows = products(arithmetic, opposed(arithmetic, columns))
    assert rows.shape == (2 * order**3 - 1, columns)
    assert verify(rows, Constraints((order,) * columns), 3).valid


@pytest.mark.parametrize(
    ("order", "number", "columns", "strength", "size"),
    [(3, 2, 9, 3, 51), (4, 2, 13, 3, 124), (3, 3, 14, 3, 75), (3, 2, 8, 4, 159)],
)
def test_a_family_that_begins_with_ones_shares_its_constant_rows(
    order: int, number: int, columns: int, strength: int, size: int
) -> None:
    """n (q^t - q) + q rows (Sherwood, Martirosyan and Colbourn 2006)."""
    arithmetic = galois_field(order)
    assert arithmetic is not None
    family = searched(arithmetic, (number, columns, strength), 0)
    assert family is not None and (family[:, :, 0] == 1).all()
    rows = products(arithmetic, family)
    assert (
        rows.shape == (size, columns)
        and verify(rows, Constraints((order,) * columns), strength).valid
    )
    if order == 3:  # A prime, so determinants of integers tell what is independent.
        for columns_ in combinations(range(columns), strength):
            assert any(round(np.linalg.det(vectors[list(columns_)])) % order for vectors in family)


def test_a_search_without_a_chance_is_not_begun() -> None:
    arithmetic = galois_field(3)
    assert arithmetic is not None
    assert searched(arithmetic, (2, 200, 4), 0) is None  # 64 million sets of columns.


def test_no_family_is_found_where_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """In one row, ten columns over three elements have three vectors of a common plane."""
    monkeypatch.setattr(hash_families, "DETERMINANTS", 10_000)
    arithmetic = galois_field(3)
    assert arithmetic is not None
    assert searched(arithmetic, (1, 10, 3), 0) is None


def test_missing_values_are_free_and_only_small_enough_arrays_are_made() -> None:
    sizes = (3, 4, 2, *(4,) * 8)
    rows = from_hash_family(sizes, 3, 125, 0)
    assert (
        rows is not None
        and len(rows) <= 124
        and (rows < sizes).all()
        and (rows[:, 2] == FREE).any()
    )
    assert verify(np.where(rows == FREE, 0, rows).astype(np.int64), Constraints(sizes), 3).valid
    assert from_hash_family(sizes, 3, 124, 0) is None
    again = from_hash_family(sizes, 3, 125, 0)
    assert again is not None and np.array_equal(rows, again)


@pytest.mark.usefixtures("short_annealing")
@pytest.mark.parametrize(("sizes", "strength", "size"), [((4,) * 16, 3, 127), ((3,) * 9, 4, 159)])
def test_a_plan_starts_from_a_family(sizes: tuple[int, ...], strength: int, size: int) -> None:
    array = covering_array(Constraints(sizes), strength)
    assert array.size <= size and verify(array.rows, Constraints(sizes), strength).valid


def test_no_construction_begins_after_the_time() -> None:
    limits = Constraints((4,) * 9)

    def started(go_on: bool) -> int:
        nothing, rng = np.zeros((0, 9), np.int32), np.random.default_rng(0)
        return len(
            Search(of_strength(limits, 3), limits, nothing, rng, lambda share, size: None).start(
                lambda: go_on
            )
        )

    assert started(True) == 124 < started(False)
