"""The number of failure regions that a campaign found."""

from __future__ import annotations

import numpy as np
from scores import chance_radius, count_regions

from pipeline.core.distance import mixed_distance
from pipeline.core.space import Space, Variable
from tests.spaces import SMALL, THESIS


def test_clusters_count_and_single_failures_do_not() -> None:
    near = [[1.0, 0, 1, 0], [1.2, 5, 1, 0], [1.4, 355, 1, 0]]
    far = [[9.0, 180, 5, 2], [9.2, 185, 5, 2], [9.1, 175, 5, 2], [9.3, 180, 5, 2]]
    alone = [[5.0, 90, 3, 1]]
    assert count_regions(SMALL, np.array(near + far + alone), 0.05, 3) == 2
    assert count_regions(SMALL, np.array(alone), 0.05, 3) == 0


def test_the_radius_contains_the_expected_failures_by_chance() -> None:
    failures, neighbours = 200, 2.0
    radius = chance_radius(THESIS, failures, neighbours)
    points = THESIS.sample(failures, np.random.default_rng(5))
    inside = (mixed_distance(THESIS, points, points) <= radius).sum(axis=1) - 1
    assert 0.7 * neighbours < inside.mean() < 1.4 * neighbours
    assert (
        chance_radius(THESIS, 2 * failures, neighbours)
        < radius
        < chance_radius(THESIS, failures, 2 * neighbours)
    )
    assert chance_radius(THESIS, 1, neighbours) == 1


def test_a_space_of_few_categories_has_a_radius_too() -> None:
    space = Space(tuple(Variable(name, "categorical", values=("a", "b", "c")) for name in "uvw"))
    assert 0 < chance_radius(space, 200, 0.5) < 1 / 3
