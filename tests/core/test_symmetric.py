"""Fields, orthogonal arrays, doubling and symmetric arrays, each against its definition."""

from __future__ import annotations

from itertools import combinations, count

import numpy as np
import pytest

from pipeline.core.constraints import Constraints, Literal
from pipeline.core.coverage import symmetric
from pipeline.core.coverage.arrays import Effort, covering_array
from pipeline.core.coverage.bounds import lower_bound
from pipeline.core.coverage.constructions import FREE, doubled, factorial, orthogonal
from pipeline.core.coverage.fields import galois_field
from pipeline.core.coverage.grid import Int32s
from pipeline.core.coverage.problem import of_strength
from pipeline.core.coverage.repair import repaired
from pipeline.core.coverage.symmetric import SymmetricSearch, symmetries
from pipeline.core.coverage.verification import verify


@pytest.mark.parametrize("order", [2, 3, 4, 5, 7, 8, 9, 16, 25, 27])
def test_fields_satisfy_the_axioms(order: int) -> None:
    field = galois_field(order)
    assert field is not None
    add, times, every = field.add, field.times, np.arange(order)
    assert np.array_equal(add, add.T) and np.array_equal(times, times.T)
    assert np.array_equal(add[0], every) and np.array_equal(times[1], every) and not times[0].any()
    assert all(sorted(row) == every.tolist() for row in add) and all(
        sorted(row) == every.tolist() for row in times[1:]
    )
    a, b, c = np.indices((order,) * 3)
    assert np.array_equal(times[a, add[b, c]], add[times[a, b], times[a, c]])
    assert np.array_equal(times[a, times[b, c]], times[times[a, b], c]) and np.array_equal(
        add[a, add[b, c]], add[add[a, b], c]
    )
    assert sorted(field.powers()) == every[1:].tolist()


@pytest.mark.parametrize("order", [0, 1, 6, 10, 12, 36])
def test_there_is_no_other_field(order: int) -> None:
    assert galois_field(order) is None


@pytest.mark.parametrize(
    ("order", "columns", "strength"),
    [(4, 5, 2), (9, 10, 2), (3, 4, 3), (4, 6, 3), (5, 6, 3), (8, 10, 3), (4, 5, 4)],
)
def test_orthogonal_arrays_hold_every_cell_once(order: int, columns: int, strength: int) -> None:
    rows = orthogonal((order,) * columns, strength, order**strength)
    assert rows is not None and rows.shape == (order**strength, columns)
    for plane in combinations(range(columns), strength):
        assert len(np.unique(rows[:, plane], axis=0)) == len(rows)
    assert orthogonal((order,) * columns, strength, order**strength - 1) is None


@pytest.mark.parametrize(
    "sizes",
    [(13, 12, 12, 12, 12, 11, 6), (12,) * 7, (5, 4, 4, 4, 4), (9,) * 10, (3, 8, 20, 8), (7, 5, 5)],
)
def test_a_factorial_with_a_difference_matrix_covers_every_pair(sizes: tuple[int, ...]) -> None:
    rows = factorial(sizes)
    assert rows is not None and len(rows) == lower_bound(sizes, 2)
    assert verify(np.where(rows == FREE, 0, rows).astype(np.int64), Constraints(sizes), 2).valid


@pytest.mark.parametrize("sizes", [(12,) * 8, (6, 6, 6), (4,) * 6])
def test_a_factorial_without_a_difference_matrix_leaves_columns_free(
    sizes: tuple[int, ...],
) -> None:
    rows = factorial(sizes)
    assert rows is not None and len(rows) == sizes[0] ** 2 and (rows[:, 2:] == FREE).all()


@pytest.mark.usefixtures("short_annealing")
@pytest.mark.parametrize("sizes", [(2,) * 8, (3,) * 7, (4, 4, 3, 3, 2, 2)])
def test_a_doubled_array_has_strength_three(sizes: tuple[int, ...]) -> None:
    half = Constraints(sizes[: (len(sizes) + 1) // 2])
    three, two = (covering_array(half, strength).rows.astype(np.int32) for strength in (3, 2))
    rows = doubled(three, two, sizes)
    assert len(rows) == len(three) + (sizes[0] - 1) * len(two)
    assert verify(np.where(rows == FREE, 0, rows).astype(np.int64), Constraints(sizes), 3).valid


@pytest.mark.parametrize(("columns", "categories"), [(5, 2), (6, 3), (4, 4), (7, 5), (3, 6)])
def test_a_row_touches_the_classes_of_all_its_images(columns: int, categories: int) -> None:
    problem, rng = of_strength(Constraints((categories,) * columns), 2), np.random.default_rng(0)
    for symmetry in symmetries(columns, categories):
        of_cell = symmetric._classes(problem, symmetry)
        starter = rng.integers(0, categories, (1, columns)).astype(np.int32)
        images = symmetry.orbits(starter)
        of_one, of_all = (
            set(of_cell[problem.counts(rows) > 0].tolist())
            for rows in (with_constants(starter, symmetry), images)
        )
        assert of_one == of_all
        assert symmetry.constants or symmetry.order % len(images) == 0


def with_constants(rows: Int32s, symmetry: symmetric.Symmetry) -> Int32s:
    constants = np.array(
        [[category] * rows.shape[1] for category in symmetry.constants], np.int32
    ).reshape(-1, rows.shape[1])
    return np.vstack([rows, constants])


@pytest.mark.parametrize(
    ("categories", "columns", "strength", "size"), [(3, 10, 3, 45), (3, 8, 4, 129)]
)
def test_symmetric_arrays_reach_published_sizes(
    categories: int, columns: int, strength: int, size: int
) -> None:
    sizes, calls = (categories,) * columns, iter(range(120))
    search, fewest = SymmetricSearch(sizes, strength, np.random.default_rng(0)), 4 * size
    while (rows := search.smaller(fewest, lambda: next(calls, None) is not None)) is not None:
        assert (
            len(rows) < fewest and verify(rows.astype(np.int64), Constraints(sizes), strength).valid
        )
        fewest = len(rows)
        if fewest <= size:
            return
    raise AssertionError(f"got {fewest}")


def test_lengths_of_searches_follow_the_universal_sequence() -> None:
    assert [symmetric.luby(number) for number in range(1, 16)] == [
        1,
        1,
        2,
        1,
        1,
        2,
        4,
        1,
        1,
        2,
        1,
        1,
        2,
        4,
        8,
    ]


class Ticks(Effort):
    """Time passes by one each time it is asked, so what is found does not depend on the machine."""

    passed = count()

    def clock(self) -> float:
        return float(next(self.passed))


def test_polishing_takes_columns_of_fewer_categories_along() -> None:
    sizes = (3, 3, 2, 3, 3, 3, 3, 3, 2)
    array = covering_array(Constraints(sizes), 3, effort=Ticks(16))
    assert verify(array.rows, Constraints(sizes), 3).valid and array.size <= 45


def test_a_repaired_row_is_in_its_cell_and_breaks_no_clause() -> None:
    # Columns 0, 1 and 2 are equal, so no single change of them keeps a row feasible; 0 and 4
    # exclude each other's category 1.
    same = tuple((Literal(a, c, False), Literal(a + 1, c)) for a in (0, 1) for c in range(4))
    linked = Constraints((4, 4, 4, 3, 2), (*same, (Literal(0, 1, False), Literal(4, 1, False))))
    problem = of_strength(linked, 2)
    for cell in np.flatnonzero(problem.required).tolist():
        columns, categories = problem.cell(cell)
        plane = int(np.searchsorted(problem.first, cell, side="right")) - 1
        place, rows = (
            (plane, cell - int(problem.first[plane])),
            [np.array([3, 3, 3, 0, 1], np.int32) for _ in range(100)],
        )
        repairs = [row for row in rows if repaired(problem.grid, row, place)]
        assert repairs  # A repair draws at random and may fail.
        assert (
            all(np.array_equal(row[columns], categories) for row in repairs)
            and linked.holds(np.array(repairs, np.int64)).all()
        )
