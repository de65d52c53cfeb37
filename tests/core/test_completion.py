"""The fewest points that complete the coverage.

The paper's example, weights under constraints, and the bound of larger domains.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.constraints import Constraints, Literal
from pipeline.core.coverage import completion
from pipeline.core.coverage.arrays import Effort
from pipeline.core.coverage.bounds import lower_bound
from pipeline.core.coverage.certified import certified_array
from pipeline.core.coverage.projection import Demand, projection_coverage
from pipeline.core.coverage.proposals import Proposer

pytestmark = pytest.mark.usefixtures("short_annealing")

PAPER = Constraints((3, 2, 2, 2, 2, 2), ((Literal(2, 1), Literal(3, 0)),))
"""Weather, lane orientation, lanes, current lane, forward and oncoming vehicle.

A car in lane 2 has two lanes."""
GIVEN = np.array(
    [
        [2, 0, 1, 0, 1, 0],
        [2, 1, 1, 0, 1, 0],
        [2, 1, 0, 0, 0, 1],
        [2, 1, 1, 0, 1, 1],
        [2, 1, 0, 0, 0, 1],
    ]
)
"""E1 to E5 as in Table 1, which says no more about E5: it is assumed to equal E3."""


@pytest.mark.parametrize(("given", "k", "fewest"), [(5, 2, 5), (0, 2, 7), (0, 3, 18), (0, 1, 3)])
def test_the_paper_s_domain_needs_this_many_points(given: int, k: int, fewest: int) -> None:
    """Section 5 adds six points to its five."""
    demand, points = Demand(PAPER, k), GIVEN[:given]
    completion = Proposer(demand).completion(points)
    assert completion.smallest and completion.bound == len(completion.categories) == fewest
    assert projection_coverage(np.vstack([points, completion.categories]), demand).ratio == 1


def test_weights_under_a_constraint_share_points() -> None:
    """Three points for each category of c0 and c1 = v0; points with c1 = v1 lack c0 = v0."""
    linked = Constraints((2, 2), ((Literal(1, 1), Literal(0, 1, equal=False)),))
    proposer = Proposer(Demand(linked, 1, [[3, 3], [3, 2]]))
    completion = proposer.completion(np.zeros((0, 2), np.int64))
    assert completion.smallest
    assert sorted(completion.categories.tolist()) == [[0, 0]] * 3 + [[1, 1]] * 3


def test_only_the_conditions_that_miss_something_are_listed() -> None:
    """Thirty conditions have too many points, but only a single condition lacks categories.

    A constraint links it with another.
    """
    wide = Constraints((5,) + (2,) * 29, ((Literal(0, 4, equal=False), Literal(1, 0)),))
    points = np.zeros((3, 30), np.int64)
    points[1:] = [[1] * 30, [2] + [1] * 29]
    completion = Proposer(Demand(wide, 1)).completion(points)
    assert (
        completion.smallest
        and sorted(completion.categories[:, 0]) == [3, 4]
        and wide.holds(completion.categories).all()
    )


def test_a_large_domain_gets_the_bound_of_its_part() -> None:
    """Eleven points cover five conditions of three values, so eight conditions need as many.

    A single plane gives a bound of nine.
    """
    completion = Proposer(Demand(Constraints((3,) * 8), 2)).completion(np.zeros((0, 8), np.int64))
    assert lower_bound((3,) * 8, 2) == 9 and completion.bound == 11 <= len(completion.categories)


def test_a_programme_that_ends_early_gives_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(completion, "WORK", 1)
    proposer = Proposer(Demand(Constraints((3,) * 5), 2))
    early = proposer.completion(np.zeros((0, 5), np.int64))
    assert 9 <= early.bound <= 11 <= len(early.categories)


def test_an_array_is_certified_and_keeps_its_given_rows() -> None:
    given = np.array([[2, 1, 0, 0, 1, 1], [2, 1, 0, 0, 1, 1]])
    for seeds, fewest in ((None, 7), (given, 8)):
        array = certified_array(PAPER, 2, seeds=seeds, effort=Effort(0.01))
        assert array.size == array.lower_bound == fewest
        assert projection_coverage(array.rows, Demand(PAPER, 2)).ratio == 1
    assert array.rows[:2].tolist() == given.tolist()


def test_an_array_too_large_to_certify_is_polished() -> None:
    large = Constraints((3,) * 8)
    array = certified_array(large, 2, effort=Effort(0.2))
    assert (
        array.lower_bound == 9 < array.size
        and projection_coverage(array.rows, Demand(large, 2)).ratio == 1
    )
