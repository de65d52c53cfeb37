"""Covering arrays cover, are small, contain their seed rows, and are well ordered."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.constraints import Constraints, Literal
from pipeline.core.coverage.arrays import Effort, covering_array, order_by_new_pairs
from pipeline.core.coverage.bounds import lower_bound
from pipeline.core.coverage.projection import Demand, projection_coverage
from pipeline.core.coverage.verification import verify
from tests.spaces import THESIS

LINKED = Constraints(
    (3, 4, 2, 3), ((Literal(0, 0, False), Literal(1, 2)), (Literal(2, 1), Literal(3, 0, False)))
)


def test_the_thesis_space_takes_exactly_962_tests() -> None:
    array = covering_array(Constraints(THESIS.sizes))
    assert array.rows.shape == (962, 8) and array.lower_bound == 962 and array.cells == 8084
    assert projection_coverage(array.rows, Demand(THESIS.constraints, 2)).ratio == 1


@pytest.mark.parametrize(
    ("sizes", "strength", "limit"),
    [
        ((3,) * 4, 2, 9), ((3,) * 13, 2, 17), ((4,) * 10, 2, 29), ((4, 6, 2), 2, 24),
        ((5, 2, 2, 2), 2, 10), ((7,), 1, 7), ((2,) * 100, 2, 15), ((2,) * 20, 3, 25),
        ((3, 2, 2, 2, 3), 4, 38), ((2,) * 8, 5, 64), ((2,) * 7, 6, 64), ((10,) * 20, 2, 197),
    ],
)  # fmt: skip
def test_arrays_cover_with_few_rows(sizes: tuple[int, ...], strength: int, limit: int) -> None:
    array = covering_array(Constraints(sizes), strength)
    assert verify(array.rows, Constraints(sizes), strength).valid
    assert array.lower_bound <= array.size <= limit


@pytest.mark.usefixtures("short_annealing")
@pytest.mark.parametrize("strength", [1, 2, 3, 4])
def test_constrained_arrays_hold_every_feasible_cell_and_no_other(strength: int) -> None:
    array = covering_array(LINKED, strength)
    checked = verify(array.rows, LINKED, strength)
    assert checked.valid and checked.cells == array.cells and array.lower_bound <= array.size
    assert projection_coverage(array.rows, Demand(LINKED, strength)).ratio == 1


@pytest.mark.usefixtures("short_annealing")
def test_seed_rows_come_first_and_stay() -> None:
    seeds = np.array([[0, 2, 0, 1], [1, 1, 1, 0], [1, 1, 1, 0]])
    for effort in (Effort(), Effort(polish_s=0.3)):
        array = covering_array(LINKED, 2, seeds=seeds, effort=effort)
        assert np.array_equal(array.rows[:3], seeds) and verify(array.rows, LINKED, 2).valid
        assert array.lower_bound <= array.size
    # The two seeds share a category of the largest column, so 4 of its 5 categories are left.
    array = covering_array(Constraints((5, 4, 3)), 1, seeds=np.array([[0, 1, 2], [0, 2, 1]]))
    assert array.size == array.lower_bound == 6


def test_polishing_never_enlarges_an_array_and_reports_progress() -> None:
    reports: list[tuple[float, int, int]] = []
    free = Constraints((4,) * 10)
    quick = covering_array(free)
    covering_array(Constraints((3,) * 5), effort=Effort(0.1))  # Compiles what only polishing needs.
    polished = covering_array(
        free, effort=Effort(1.5, lambda *now: reports.append(now), processor=True)
    )
    assert polished.size <= quick.size + 1 and verify(polished.rows, free, 2).valid
    assert all(0 <= share <= 1 and bound == 16 for share, _, bound in reports)
    assert reports[0][1] == 0 and reports[-1][1] >= polished.size


@pytest.mark.usefixtures("short_annealing")
def test_only_the_seed_changes_the_array() -> None:
    first, second, other = (
        covering_array(Constraints((3, 4, 5, 2)), seed=seed).rows for seed in (5, 5, 6)
    )
    assert np.array_equal(first, second) and not np.array_equal(first, other)
    # Also with a solver that answered other queries before.
    asked = Constraints(LINKED.sizes, LINKED.clauses)
    before = covering_array(asked).rows
    asked.complete({0: 1}, np.random.default_rng(3))
    assert np.array_equal(before, covering_array(asked).rows)


@pytest.mark.parametrize(
    ("sizes", "strength", "bound"),
    [
        ((2,) * 10, 2, 6),
        ((2,) * 35, 2, 8),
        ((2,) * 100, 2, 10),
        ((5, 4, 3), 2, 20),
        ((5, 4, 3), 3, 60),
        ((2,) * 20, 3, 16),
        ((6, 5), 1, 6),
    ],
)
def test_lower_bounds(sizes: tuple[int, ...], strength: int, bound: int) -> None:
    assert lower_bound(sizes, strength) == bound


def test_the_bound_counts_feasible_cells_alone() -> None:
    only = Constraints((3, 3, 2), ((Literal(0, 0), Literal(1, 0)),))
    assert (
        lower_bound(only.sizes, 2, only) == 6
    )  # 3 x 2; 5 of the 3 x 3 cells of the first plane are feasible.


def test_impossible_arrays_are_refused() -> None:
    with pytest.raises(ValueError, match="clauses 0, 2 contradict each other"):
        covering_array(Constraints((2, 2), ((Literal(0, 0),), (Literal(1, 0),), (Literal(0, 1),))))
    with pytest.raises(ValueError, match="seed row 1 breaks clause 0"):
        covering_array(Constraints((2, 2), ((Literal(0, 0),),)), seeds=np.array([[0, 0], [1, 0]]))
    with pytest.raises(ValueError, match=r"strength must be in \[1, 2\], got 3"):
        covering_array(Constraints((2, 2)), 3)
    with pytest.raises(ValueError, match="polish_s must be positive, got 0"):
        Effort(polish_s=0)


@pytest.mark.usefixtures("short_annealing")
def test_the_verifier_finds_missing_cells_and_broken_clauses() -> None:
    rows = covering_array(LINKED, 2).rows
    shorter = verify(rows[1:], LINKED, 2)
    assert not shorter.valid and shorter.missing and not shorter.broken
    wrong = rows.copy()
    wrong[0] = (0, 0, 0, 0)
    assert (0, 0) in verify(wrong, LINKED, 2).broken


def test_the_order_takes_the_row_with_the_most_new_pairs() -> None:
    rows = covering_array(Constraints((4, 3, 3, 2))).rows
    order = order_by_new_pairs(rows)
    assert sorted(order.tolist()) == list(range(len(rows)))
    covered: set[tuple[int, int, int, int]] = set()

    def new(row: int) -> set[tuple[int, int, int, int]]:
        return {
            (i, j, rows[row, i], rows[row, j]) for i in range(4) for j in range(i + 1, 4)
        } - covered

    for position, row in enumerate(order):
        assert len(new(row)) == max(len(new(other)) for other in order[position:])
        covered |= new(row)
    assert order_by_new_pairs(rows[:0]).tolist() == []


def test_a_row_that_breaks_a_constraint_makes_an_array_invalid_and_covers_nothing() -> None:
    constraints = Constraints((2, 2, 2), ((Literal(0, 0, False), Literal(1, 0, False)),))
    verification = verify(np.array([[0, 0, 1]]), constraints, 2)
    assert verification.broken == ((0, 0),) and verification.infeasible == 1
    assert ((0, 2), (0, 1)) in verification.missing
    every = verify(np.array(list(np.ndindex(2, 2, 2))), constraints, 2)
    assert every.missing == () and not every.valid
