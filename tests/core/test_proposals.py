"""Proposals are optimal, respect the constraints and end at full coverage."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from pipeline.core.constraints import Constraints, Literal
from pipeline.core.coverage import completion
from pipeline.core.coverage.projection import Demand, projection_coverage
from pipeline.core.coverage.proposals import Proposer

pytestmark = pytest.mark.usefixtures("short_annealing")

CONSTRAINED = Constraints(
    (3, 2, 2, 2),
    ((Literal(1, 1), Literal(2, 1, equal=False)), (Literal(0, 2, equal=False), Literal(3, 0))),
)


@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("constraints", [CONSTRAINED, Constraints((3, 2, 4, 2))])
def test_no_point_gains_more(constraints: Constraints, k: int, seed: int) -> None:
    every = np.array(list(product(*map(range, constraints.sizes))))
    every = every[constraints.holds(every)]
    points = every[np.random.default_rng(seed).choice(len(every), seed, replace=False)]

    def covered(rows: np.ndarray) -> int:
        return projection_coverage(rows, Demand(constraints, k)).covered

    gains = [covered(np.vstack([points, point])) - covered(points) for point in every]
    proposal = Proposer(Demand(constraints, k)).propose_exact(points)
    if max(gains) == 0:
        assert proposal is None
        return
    assert (
        proposal is not None and constraints.holds(proposal.categories).all() and proposal.optimal
    )
    assert (
        covered(np.vstack([points, proposal.categories])) - covered(points)
        == proposal.gain
        == max(gains)
    )


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_completion_covers_every_feasible_cell(k: int) -> None:
    start = np.array([[2, 0, 0, 0]])
    points = np.vstack(
        [
            start,
            *(proposal.categories for proposal in Proposer(Demand(CONSTRAINED, k)).complete(start)),
        ]
    )
    assert projection_coverage(points, Demand(CONSTRAINED, k)).ratio == 1
    assert Proposer(Demand(CONSTRAINED, k)).propose(points) is None


def test_heavy_classes_come_first_on_request() -> None:
    free = Constraints((3, 3, 3))
    weights = [[1, 1, 5], [1, 1, 1], [1, 1, 1]]
    # Nothing is heavier than category 2 of the first condition; all points add as many new cells.
    heavy = Proposer(Demand(free, 2, weights, "max"), heavy_first=True).propose(
        np.zeros((0, 3), int), 3
    )
    assert heavy is not None and (heavy.categories[:, 0] == 2).all()


@pytest.mark.parametrize("seed", range(6))
def test_the_bound_of_heavy_points_has_the_unit_of_their_gain(seed: int) -> None:
    rng = np.random.default_rng(seed)
    weights = [rng.integers(1, 6, size) for size in (3, 2, 3)]
    proposer = Proposer(Demand(Constraints((3, 2, 3)), 2, weights), heavy_first=True)
    points = rng.integers(0, 2, (4, 3))
    missing = proposer.missing(points)
    every = product(range(3), range(2), range(3))
    worth = [
        int((missing - proposer.missing(np.vstack([points, row]))) @ proposer._wanted)
        for row in every
    ]
    proposal = proposer.propose_exact(points, 1, 5.0)
    assert proposal is not None and proposal.optimal and proposal.gain == max(worth)


def test_heavy_points_are_worth_products_of_the_largest_weights() -> None:
    for k in (3, 4):
        proposer = Proposer(Demand(Constraints((2, 2, 2, 2)), k, [[1, 999]] * 4), heavy_first=True)
        proposal = proposer.propose(np.zeros((0, 4), int))
        assert proposal is not None and proposal.categories.tolist() == [[1, 1, 1, 1]]
        assert proposal.gain == proposal.bound == (4 * 999**3 if k == 3 else 999**4)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_batch_gains_at_least_what_single_points_gain_and_no_more_than_its_bound(
    count: int,
) -> None:
    start = np.array([[2, 0, 0, 0], [0, 1, 1, 1]])
    proposer = Proposer(Demand(CONSTRAINED, 2))
    exact = proposer.propose_exact(start, count)
    assert exact is not None and exact.optimal
    single = start
    for _ in range(count):
        proposal = proposer.propose(single)
        single = single if proposal is None else np.vstack([single, proposal.categories])

    def covered(rows: np.ndarray) -> int:
        return projection_coverage(rows, Demand(CONSTRAINED, 2)).covered

    assert exact.gain == covered(np.vstack([start, exact.categories])) - covered(start)
    assert exact.gain >= covered(single) - covered(start)


def test_one_projection_is_completed_by_the_fewest_points() -> None:
    """Algorithm 1 on the data of Equation 1, and with weights.

    As many points as the condition that lacks most.
    """
    free = Constraints((2, 2, 2, 2))
    data = np.array([[0, 0, 1, 1], [1, 0, 0, 0], [1, 0, 0, 1]])
    assert Proposer(Demand(free, 1)).completion(data).categories[:, 1].tolist() == [1]
    weights = [[2, 1], [1, 4], [1, 1], [2, 2]]
    proposer = Proposer(Demand(free, 1, weights))
    added = proposer.completion(data)
    assert len(added.categories) == proposer.fewest(data) == added.bound == 4
    both = np.vstack([data, added.categories])
    assert projection_coverage(both, Demand(free, 1, weights)).ratio == 1


def test_a_completion_may_combine_more_conditions_than_a_plan(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(completion, "MOST_KINDS", 0)  # Larger domains are not listed.
    demand, start = Demand(Constraints((2,) * 8), 7), np.zeros((1, 8), int)
    added = Proposer(demand).completion(start)
    assert (
        projection_coverage(np.vstack([start, added.categories]), demand).ratio == 1
        and added.bound == 127
    )


@pytest.mark.parametrize("weights", [None, [[1, 2, 1], [1, 1], [3, 1], [1, 1]]])
@pytest.mark.parametrize("k", [1, 2, 3])
def test_a_completion_leaves_nothing_missing_and_respects_its_bound(
    k: int, weights: list[list[int]] | None
) -> None:
    start = np.array([[2, 0, 0, 0]])
    proposer = Proposer(Demand(CONSTRAINED, k, weights, "max"))
    added = proposer.completion(start)
    both = np.vstack([start, added.categories])
    assert projection_coverage(both, Demand(CONSTRAINED, k, weights, "max")).ratio == 1
    assert (
        added.smallest and added.bound >= proposer.fewest(start) > 0 and proposer.fewest(both) == 0
    )
    again = Proposer(Demand(CONSTRAINED, k, weights, "max")).completion(start)
    assert np.array_equal(again.categories, added.categories)
