"""Covering arrays cover, are small where the smallest is known, and are ordered well."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.constraints import Constraints, Literal
from pipeline.core.coverage.arrays import covering_array, order_by_new_pairs
from pipeline.core.coverage.projection import projection_coverage
from tests.spaces import THESIS


def test_the_thesis_space_takes_exactly_962_tests() -> None:
    rows = covering_array(THESIS.sizes, np.random.default_rng(0))
    assert rows.shape == (962, 8)
    assert projection_coverage(rows, THESIS.sizes, 2).ratio == 1


@pytest.mark.parametrize(
    ("sizes", "limit"),
    [((3,) * 4, 9), ((3,) * 13, 20), ((4,) * 10, 31), ((4, 6, 2), 24), ((5, 2, 2, 2), 10), ((7,), 7)],
)
def test_arrays_cover_with_few_rows(sizes: tuple[int, ...], limit: int) -> None:
    rows = covering_array(sizes, np.random.default_rng(0))
    assert projection_coverage(rows, sizes, min(2, len(sizes))).ratio == 1
    assert len(rows) <= limit


def test_constrained_arrays_hold_every_feasible_pair_and_no_other() -> None:
    sizes = (3, 4, 2, 3)
    constraints = Constraints(sizes, ((Literal(0, 0, False), Literal(1, 2)), (Literal(2, 1), Literal(3, 0, False))))
    rows = covering_array(sizes, np.random.default_rng(0), constraints)
    assert constraints.holds(rows).all()
    assert projection_coverage(rows, sizes, 2, constraints=constraints).ratio == 1


def test_the_generator_alone_decides() -> None:
    first, second = (covering_array((3, 4, 5, 2), np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(first, second)


def test_the_order_takes_the_row_with_most_new_pairs_each_time() -> None:
    rows = covering_array((4, 3, 3, 2), np.random.default_rng(0))
    order = order_by_new_pairs(rows)
    assert sorted(order.tolist()) == list(range(len(rows)))
    covered: set[tuple[int, int, int, int]] = set()

    def new(row: int) -> set[tuple[int, int, int, int]]:
        return {(i, j, rows[row, i], rows[row, j]) for i in range(4) for j in range(i + 1, 4)} - covered

    for position, row in enumerate(order):
        assert len(new(row)) == max(len(new(other)) for other in order[position:])
        covered |= new(row)
    assert order_by_new_pairs(rows[:0]).tolist() == []
