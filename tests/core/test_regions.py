"""Failure regions of small, hand-made sets of failures."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.distance import mixed_distance
from pipeline.core.growth import Tested, grow_regions, readable_regions
from pipeline.core.regions import chance_radius, connected_failures, find_regions, medoid
from pipeline.core.rules import Condition, Rule, find_rule
from pipeline.core.space import Space, Variable
from tests.spaces import SMALL, THESIS


def test_density_clusters_come_larger_first_with_noise_apart() -> None:
    near = [[1.0, 0, 1, 0], [1.2, 5, 1, 0], [1.4, 355, 1, 0]]
    far = [[9.0, 180, 5, 2], [9.2, 185, 5, 2], [9.1, 175, 5, 2], [9.3, 180, 5, 2]]
    alone = [[5.0, 90, 3, 1]]
    assert find_regions(SMALL, np.array(near + far + alone), 0.05, 3).tolist() == [1, 1, 1, 0, 0, 0, 0, -1]


def test_regions_of_no_failures_and_of_wrong_arguments() -> None:
    nothing = np.zeros((0, 4))
    assert find_regions(SMALL, nothing, 0.1, 2).tolist() == []
    assert connected_failures(SMALL, nothing).tolist() == []
    with pytest.raises(ValueError, match=r"epsilon must be in \(0, 1\], got 0"):
        find_regions(SMALL, nothing, 0, 2)
    with pytest.raises(ValueError, match="min_failures must be at least 1, got 0"):
        find_regions(SMALL, nothing, 0.1, 0)


def test_connected_failures_step_to_neighbouring_categories() -> None:
    chain = [[1.0, 0, 1, 0], [2, 0, 1, 0], [2, 330, 1, 0], [2, 330, 1, 2]]
    diagonal = [[6.0, 90, 3, 1], [7, 120, 3, 1]]
    jump = [[4.0, 0, 1, 0]]
    assert connected_failures(SMALL, np.array(chain + diagonal + jump)).tolist() == [0, 0, 0, 0, 1, 2, 3]


def test_medoid_is_the_point_in_the_middle() -> None:
    assert medoid(SMALL, np.array([[0.0, 0, 1, 0], [4, 0, 1, 0], [5, 0, 1, 0], [10, 0, 1, 0]])) in (1, 2)


def test_growth_takes_in_failures_under_the_same_rule() -> None:
    rng = np.random.default_rng(0)
    points = SMALL.sample(400, rng)
    failures = points[:, 0] > 8
    # One cause: density found two halves and missed some failures.
    labels = np.where(failures, np.where(points[:, 3] == 0, 0, np.where(points[:, 3] == 1, 1, -1)), -1)
    grown = grow_regions(Tested(SMALL, points, failures), labels, 0.6, 5)
    assert (grown[failures] >= 0).mean() > 0.9 and (grown[~failures] == -1).all()
    assert grown.max() <= labels.max()


def test_the_radius_contains_the_expected_failures_by_chance() -> None:
    failures, neighbours = 200, 2.0
    radius = chance_radius(THESIS, failures, neighbours)
    points = THESIS.sample(failures, np.random.default_rng(5))
    inside = (mixed_distance(THESIS, points, points) <= radius).sum(axis=1) - 1
    assert 0.7 * neighbours < inside.mean() < 1.4 * neighbours
    assert chance_radius(THESIS, 2 * failures, neighbours) < radius < chance_radius(THESIS, failures, 2 * neighbours)
    assert chance_radius(THESIS, 1, neighbours) == 1
    with pytest.raises(ValueError, match="neighbours must be positive, got 0"):
        chance_radius(THESIS, failures, 0)


def test_a_space_of_few_categories_has_a_radius_too() -> None:
    space = Space(tuple(Variable(name, "categorical", values=("a", "b", "c")) for name in "uvw"))
    radius = chance_radius(space, 200, 0.5)
    assert 0 < radius < 1 / 3
    points = np.array([[0, 0, 0]] * 3 + [[1, 1, 1]] * 2 + [[2, 0, 0]], float)
    assert find_regions(space, points, radius, 2).tolist() == [0, 0, 0, 1, 1, -1]


@pytest.mark.parametrize("tests", [400, 2000])
def test_two_causes_that_meet_are_two_regions_at_any_number_of_failures(tests: int) -> None:
    fog, rain = Rule((Condition(1, 55, 100), Condition(3, -20, 20))), Rule((Condition(0, 70, 100), Condition(5, 2, 4)))
    points = THESIS.sample(20 * tests, np.random.default_rng(2))
    # Half of the tests at random, half as an adaptive strategy would choose them.
    points = np.concatenate([points[:tests], points[fog.holds(points) | rain.holds(points)][:tests]])
    causes = [fog.holds(points), rain.holds(points)]
    failures = causes[0] | causes[1]
    labels = readable_regions(Tested(THESIS, points, failures), chance_radius(THESIS, int(failures.sum()), 0.5), 0.75, 4)
    assert set(labels) <= {-1, 0, 1} and (labels[failures] >= 0).mean() > 0.85
    for label, cause in enumerate(causes):
        assert cause[labels == label].mean() > 0.8
        assert {c.variable for c in find_rule(THESIS, points, failures, labels == label).conditions} == [{1, 3}, {0, 5}][label]


def test_points_and_failures_must_have_equal_length() -> None:
    with pytest.raises(ValueError, match=rf"points must be \(3, {len(SMALL)}\), got \(2, {len(SMALL)}\)"):
        Tested(SMALL, SMALL.sample(2, np.random.default_rng(0)), np.zeros(3, bool))
