"""Connected failures and medoids of small, hand-made sets."""

from __future__ import annotations

import numpy as np

from pipeline.core.regions import connected_failures, largest_first, medoid
from tests.spaces import SMALL


def test_connected_failures_step_to_neighbouring_categories() -> None:
    chain = [[1.0, 0, 1, 0], [2, 0, 1, 0], [2, 330, 1, 0], [2, 330, 1, 2]]
    diagonal = [[6.0, 90, 3, 1], [7, 120, 3, 1]]
    jump = [[4.0, 0, 1, 0]]
    assert connected_failures(SMALL, np.array(chain + diagonal + jump)).tolist() == [
        0,
        0,
        0,
        0,
        1,
        2,
        3,
    ]


def test_medoid_is_the_point_in_the_middle() -> None:
    assert medoid(SMALL, np.array([[0.0, 0, 1, 0], [4, 0, 1, 0], [5, 0, 1, 0], [10, 0, 1, 0]])) in (
        1,
        2,
    )


def test_no_failures_are_in_no_set() -> None:
    assert connected_failures(SMALL, np.zeros((0, 4))).tolist() == []


def test_a_circle_has_one_step_across_its_ends_and_a_step_in_two_variables_is_none() -> None:
    assert connected_failures(SMALL, np.array([[1.0, 0, 1, 0], [1, 300, 1, 0]])).tolist() == [0, 1]
    assert connected_failures(SMALL, np.array([[1.0, 0, 1, 0], [2, 330, 1, 0]])).tolist() == [0, 1]


def test_larger_sets_come_first_and_noise_stays_noise() -> None:
    assert largest_first(np.array([5, -1, 2, 2, 7, 7, 7])).tolist() == [2, -1, 1, 1, 0, 0, 0]
