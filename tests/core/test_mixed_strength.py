"""Named planes and single combinations: plans, counts, weights, proposals by enumeration."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest

from pipeline.core.constraints import Constraints, Literal
from pipeline.core.coverage.arrays import Effort, covering_array
from pipeline.core.coverage.certified import certified_array
from pipeline.core.coverage.mixed import (
    Combination,
    Extras,
    Mixed,
    NamedPlanes,
    all_planes,
    copy_for,
)
from pipeline.core.coverage.problem import lay_out
from pipeline.core.coverage.projection import Demand, planes, projection_coverage
from pipeline.core.coverage.proposals import Proposer
from pipeline.core.coverage.repair import repaired
from pipeline.core.coverage.verification import verify
from pipeline.core.variable import Ints

pytestmark = pytest.mark.usefixtures("short_annealing")

LINKED = Constraints(
    (3, 4, 2, 3, 2), ((Literal(0, 0, False), Literal(1, 2)), (Literal(2, 1), Literal(3, 0, False)))
)
FREE = Constraints((3, 2, 4, 2, 3, 2))
EXTRAS = Extras(
    (NamedPlanes("front", (0, 1, 3), 3), NamedPlanes("rest", (1, 2, 3, 4), 3)),
    (
        Combination((0, 2), (1, 1), 4),
        Combination((0, 1, 2, 4), (1, 3, 0, 1), 2),
        Combination((0, 1, 2, 4), (2, 0, 0, 0), 1),
    ),
)
WEIGHTS = [[1, 2, 1], [1, 1, 3, 1], [1, 1], [2, 1, 1], [1, 1]]


def points_of(limits: Constraints) -> Ints:
    every = np.array(list(product(*map(range, limits.sizes))))
    return every[limits.holds(every)]


def wanted_cells(limits: Constraints, mixed: Mixed) -> set[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Plane and cell of everything that a feasible point must show, by enumeration."""
    chosen = [*combinations(range(len(limits.sizes)), mixed.strength)]
    for named in mixed.extras.planes:
        chosen += combinations(named.variables, named.strength)
    cells = {
        (plane, tuple(point[list(plane)].tolist()))
        for plane in chosen
        for point in points_of(limits)
    }
    return cells | {(cell.variables, cell.categories) for cell in mixed.extras.combinations}


def shown(rows: Ints, cells: set[tuple[tuple[int, ...], tuple[int, ...]]]) -> bool:
    return all((rows[:, list(plane)] == cell).all(axis=1).any() for plane, cell in cells)


@pytest.mark.parametrize("strength", [1, 2, 3])
@pytest.mark.parametrize(
    "extras", [EXTRAS, Extras(EXTRAS.planes), Extras(combinations=EXTRAS.combinations)]
)
def test_a_plan_shows_every_wanted_cell(strength: int, extras: Extras) -> None:
    mixed = Mixed(strength, extras)
    cells = wanted_cells(LINKED, mixed)
    array = covering_array(LINKED, mixed)
    assert array.rows.shape[1] == 5 and LINKED.holds(array.rows).all() and shown(array.rows, cells)
    assert array.cells == len(cells) and array.lower_bound <= array.size
    checked = verify(array.rows, LINKED, mixed)
    assert checked.valid and checked.cells == len(cells)
    assert (
        projection_coverage(
            array.rows, Demand(LINKED, strength, extras=Extras(extras.planes))
        ).ratio
        == 1
    )


def test_the_verifier_finds_what_a_plan_of_the_lower_strength_lacks() -> None:
    mixed = Mixed(2, EXTRAS)
    rows = covering_array(LINKED, 2).rows
    lacking = {
        (plane, cell)
        for plane, cell in wanted_cells(LINKED, mixed)
        if not shown(rows, {(plane, cell)})
    }
    assert lacking and set(verify(rows, LINKED, mixed).missing) == lacking


def test_a_row_is_repaired_although_its_plane_is_filled_up() -> None:
    chain = tuple((Literal(i, 0), Literal(i + 1, 1)) for i in range(5))
    planes = all_planes(6, Mixed(2, Extras((NamedPlanes("all", tuple(range(6)), 6),))))
    grid, row = (
        lay_out(copy_for(Constraints((2,) * 6, chain), planes), planes).grid,
        np.zeros(7, np.int32),
    )
    # As Python, which checks the bounds of arrays. Cell 3 of the first plane: categories 1 and 1,
    # from which all others follow.
    assert repaired.py_func(grid, row, (0, 3)) and row.tolist() == [1] * 6 + [0]


@pytest.mark.parametrize("effort", [Effort(), Effort(polish_s=0.5)])
def test_seed_rows_stay_and_only_the_seed_changes_the_plan(effort: Effort) -> None:
    mixed, seeds = Mixed(2, Extras(EXTRAS.planes)), np.array([[1, 1, 1, 0, 0], [2, 3, 0, 1, 1]])
    array = certified_array(LINKED, mixed, seeds=seeds, effort=effort)
    assert np.array_equal(array.rows[:2], seeds) and verify(array.rows, LINKED, mixed).valid
    if effort.polish_s is None:
        assert np.array_equal(array.rows, certified_array(LINKED, mixed, seeds=seeds).rows)


def test_a_plan_without_constraints_lies_between_the_uniform_ones() -> None:
    mixed = Mixed(2, Extras((NamedPlanes("half", (0, 2, 4, 5), 3),)))
    sizes = [certified_array(FREE, strength).size for strength in (2, mixed, 3)]
    assert sizes[0] < sizes[1] <= sizes[2] and sizes[1] >= 4 * 3 * 3
    assert shown(certified_array(FREE, mixed).rows, wanted_cells(FREE, mixed))


@pytest.mark.parametrize("seed", range(25))
def test_random_mixed_plans_show_what_enumeration_asks_for(seed: int) -> None:
    rng = np.random.default_rng(seed)
    limits = Constraints(
        tuple(rng.integers(2, 4, 5).tolist()),
        tuple(random_clause(rng) for _ in range(rng.integers(0, 3))),
    )
    every = points_of(limits)
    groups = [
        tuple(sorted(rng.choice(5, int(rng.integers(2, 6)), replace=False).tolist()))
        for _ in range(rng.integers(1, 3))
    ]
    single = [
        tuple(sorted(rng.choice(5, int(rng.integers(1, 5)), replace=False).tolist()))
        for _ in range(rng.integers(0, 3))
    ]
    extras = Extras(
        tuple(
            NamedPlanes(f"p{i}", group, int(rng.integers(1, len(group) + 1)))
            for i, group in enumerate(groups)
        ),
        tuple(
            Combination(chosen, tuple(every[rng.integers(len(every))][list(chosen)].tolist()))
            for chosen in single
        ),
    )
    mixed = Mixed(int(rng.integers(1, 4)), extras)
    array, cells = certified_array(limits, mixed), wanted_cells(limits, mixed)
    assert shown(array.rows, cells) and array.cells == len(cells) and limits.holds(array.rows).all()
    assert verify(array.rows, limits, mixed).valid and array.lower_bound <= array.size
    completed = Proposer(Demand(limits, mixed.strength, extras=extras)).completion(every[:1])
    assert (
        shown(np.vstack([every[:1], completed.categories]), cells)
        and limits.holds(completed.categories).all()
    )


def random_clause(rng: np.random.Generator) -> tuple[Literal, ...]:
    return tuple(
        Literal(int(v), int(rng.integers(2)), bool(rng.integers(2)))
        for v in rng.choice(5, 2, replace=False)
    )


def demanded(demand: Demand, rows: Ints) -> tuple[int, int]:
    """Numerator and denominator by enumeration."""
    single = {(cell.variables, cell.categories): cell.weight for cell in demand.extras.combinations}
    covered = required = 0
    for plane, cell in wanted_cells(demand.constraints, demand.mixed):
        weight = single.get(
            (plane, cell),
            int(np.prod([demand.weight_arrays()[v][c] for v, c in zip(plane, cell, strict=True)])),
        )
        covered += min(weight, int((rows[:, list(plane)] == cell).all(axis=1).sum()))
        required += weight
    return covered, required


@pytest.mark.parametrize("k", [1, 2, 4])
def test_coverage_is_what_enumeration_counts(k: int) -> None:
    every, rng = points_of(LINKED), np.random.default_rng(k)
    demand = Demand(LINKED, k, WEIGHTS, extras=EXTRAS)
    for count in (0, 3, 40):
        rows = every[rng.integers(len(every), size=count)]
        coverage = projection_coverage(rows, demand)
        assert (coverage.covered, coverage.required) == demanded(demand, rows)
    rows[::3, 1] = -1
    coverage = projection_coverage(rows, demand)
    assert (coverage.covered, coverage.required) == demanded(demand, rows)
    assert {(0, 2), (0, 1, 2, 4)} <= {plane.variables for plane in planes(demand.counts(), demand)}


def test_a_weight_of_zero_takes_a_combination_out() -> None:
    without = Extras(combinations=(Combination((0, 1), (1, 1), 0),))
    rows = np.ones((1, 6), np.int64)
    full, less = (
        projection_coverage(rows, Demand(FREE, 2, extras=extras)) for extras in (Extras(), without)
    )
    assert (less.covered, less.required) == (full.covered - 1, full.required - 1)
    assert without.of(2) == without and not without.of(3)


@pytest.mark.parametrize("k", [1, 2])
@pytest.mark.parametrize("exact", [False, True])
def test_no_point_gains_more_than_the_proposed_one(k: int, exact: bool) -> None:
    every = points_of(LINKED)
    demand = Demand(LINKED, k, WEIGHTS, extras=EXTRAS)
    proposer, rows = Proposer(demand), every[[0, 7, 19]]
    proposal = proposer.propose_exact(rows, 1) if exact else proposer.propose(rows, 1)
    assert (
        proposal is not None
        and proposal.categories.shape == (1, 5)
        and LINKED.holds(proposal.categories).all()
    )
    before = demanded(demand, rows)[0]
    gains = [demanded(demand, np.vstack([rows, point]))[0] - before for point in every]
    assert (
        demanded(demand, np.vstack([rows, proposal.categories]))[0] - before
        == proposal.gain
        == max(gains)
    )


def test_a_completion_fills_every_weight() -> None:
    demand = Demand(LINKED, 2, WEIGHTS, extras=EXTRAS)
    start = points_of(LINKED)[:4]
    proposer = Proposer(demand)
    completion = proposer.completion(start)
    covered, required = demanded(demand, np.vstack([start, completion.categories]))
    assert (
        covered == required
        and completion.bound <= len(completion.categories)
        and completion.categories.shape[1] == 5
    )
    assert proposer.propose(np.vstack([start, completion.categories])) is None
