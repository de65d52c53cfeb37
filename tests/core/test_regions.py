"""Failure regions of small, hand-made sets of failures."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.distance import mixed_distance
from pipeline.core.regions import chance_radius, connected_failures, find_regions, medoid
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
