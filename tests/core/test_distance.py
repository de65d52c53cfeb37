"""The mixed distance and the relevance score, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.distance import mixed_distance, relevance
from tests.spaces import SMALL


def test_distance_is_the_mean_over_variables() -> None:
    a = np.array([[0.0, 350, 1, 0]])
    b = np.array([[5.0, 10, 3, 1], [0, 350, 1, 0], [0, 170, 1, 0]])
    # x 0.5, angle 20 of 180 degrees, count 0.5, kind 1.
    assert mixed_distance(SMALL, a, b) == pytest.approx(
        np.array([[(0.5 + 20 / 180 + 0.5 + 1) / 4, 0, 0.25]])
    )


def test_relevance_is_non_failures_minus_failures_nearer_than_epsilon() -> None:
    tests = np.array([[0.0, 0, 1, 0], [0.4, 0, 1, 0], [0.8, 0, 1, 0], [10, 0, 1, 0]])
    failures = np.array([True, True, False, True])
    candidates = np.array([[0.0, 0, 1, 0], [10, 0, 1, 0], [5, 0, 1, 0]])
    assert relevance(SMALL, candidates, tests, failures, 0.03).tolist() == [-1, -1, 0]
    # 0.4 of 10 m is 0.01 on the mean of four variables: the ball is open.
    assert relevance(SMALL, candidates[:1], tests[:2], failures[:2], 0.01).tolist() == [-1]


def test_relevance_without_tests_is_zero() -> None:
    assert relevance(
        SMALL, np.zeros((2, 4)), np.zeros((0, 4)), np.zeros(0, bool), 0.1
    ).tolist() == [0, 0]
