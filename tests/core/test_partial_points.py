"""Points with unknown categories.

Counted in the cells that they determine, left out if no completion of them is feasible.
"""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest

from pipeline.core.constraints import Constraints, Literal
from pipeline.core.coverage.counting import FEW_POINTS, CellCounts
from pipeline.core.coverage.partial import broken_clauses
from pipeline.core.coverage.projection import Demand, projection_coverage
from pipeline.core.coverage.proposals import Proposer
from pipeline.core.coverage.verification import verify

# x = 0 implies y = 1, and y = 1 implies z = 0: together they exclude x = 0 with z = 1.
CHAIN = Constraints(
    (2, 2, 2), ((Literal(0, 0, False), Literal(1, 1)), (Literal(1, 1, False), Literal(2, 0)))
)


@pytest.mark.parametrize("count", [40, FEW_POINTS + 500])
@pytest.mark.parametrize("k", [1, 2, 3])
def test_a_partial_point_counts_in_the_cells_that_it_determines(k: int, count: int) -> None:
    sizes, rng = (3, 2, 4, 2), np.random.default_rng(k)
    points = rng.integers(-1, sizes, (count, 4))
    points[:, 1] = np.abs(points[:, 1])  # This condition is always known.
    counts = CellCounts(sizes, k)
    for batch in np.array_split(points, 2):
        counts.add(batch)
    for plane, cells in counts:
        expected = np.zeros(cells.shape, int)
        np.add.at(expected, tuple(points[(points[:, plane] >= 0).all(axis=1)][:, plane].T), 1)
        assert np.array_equal(cells, expected)


def test_clauses_that_a_point_breaks_are_found_as_by_trying_every_completion() -> None:
    rows = np.array(list(product((-1, 0, 1), repeat=3)))
    feasible = [
        row
        for row in product((0, 1), repeat=3)
        if (row[0] != 0 or row[1] == 1) and (row[1] != 1 or row[2] == 0)
    ]
    result = broken_clauses(CHAIN, rows)
    for row, clause in zip(rows, result, strict=True):
        possible = any(
            all(given in (-1, value) for given, value in zip(row, other, strict=True))
            for other in feasible
        )
        assert (clause < 0) == possible
    assert (
        dict(zip(map(tuple, rows.tolist()), result.tolist(), strict=True))[0, -1, 1] == 2
    )  # Both clauses together.
    assert broken_clauses(CHAIN, np.array([[0, 0, 1], [1, 1, 1], [0, -1, -1]])).tolist() == [
        0,
        1,
        -1,
    ]


def test_coverage_and_proposals_take_partial_points() -> None:
    demand = Demand(Constraints((2, 2)), 2)
    points = np.array([[0, 0], [1, -1], [-1, -1]])
    assert projection_coverage(points, demand).covered == 1
    assert projection_coverage(points, Demand(Constraints((2, 2)), 1)).covered == 3
    assert len(Proposer(demand).completion(points).categories) == 3
    assert Proposer(Demand(Constraints((2, 2)), 1)).fewest(points) == 1


@pytest.mark.parametrize("strength", [1, 2])
def test_a_row_that_breaks_a_clause_covers_nothing(strength: int) -> None:
    kept = np.array([[0, 1, 0], [1, 0, 0], [1, 0, 1], [1, 1, 0]])
    rows = np.vstack([kept, [[0, 0, 1]]])
    checked = verify(rows, CHAIN, strength)
    assert checked.broken == ((4, 0),) and not checked.valid and not checked.missing
    planes = list(combinations(range(3), strength))
    assert checked.cells == sum(len({tuple(row[list(plane)]) for row in kept}) for plane in planes)
