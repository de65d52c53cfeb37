"""Failure sequence, F- and C-measure and pair coverage, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.measures import (
    c_measure,
    f_measure,
    failure_sequence,
    feasible_pairs,
    kinds,
    kinds_of,
    pair_coverage,
)
from pipeline.core.space import Space, Variable
from tests.spaces import SMALL, THESIS


def test_failure_sequence_and_f_measure() -> None:
    theta = failure_sequence([False, True, False, True])
    assert theta.tolist() == [0, 1, 1, 2]
    assert [f_measure(theta, n) for n in (1, 2, 3)] == [2, 4, None]
    assert f_measure(failure_sequence([]), 1) is None
    with pytest.raises(ValueError, match="n must be at least 1, got 0"):
        f_measure(theta, 0)


def test_c_measure_of_example_4_5() -> None:
    baseline = failure_sequence([False] * 99 + [True])
    assert c_measure(failure_sequence([True]), baseline) == (1, 0.99)


def test_c_measure_takes_n_from_the_baseline() -> None:
    baseline = failure_sequence([True, False, False, True])
    assert c_measure(failure_sequence([True, True, False, False]), baseline) == (2, 0.5)
    assert c_measure(failure_sequence([False, True, False, False]), baseline) == (2, None)


def test_c_measure_against_a_baseline_without_failures() -> None:
    """Equation 6.2: the next test is assumed to be the baseline's first failure."""
    n, saved = c_measure(failure_sequence([False, True]), failure_sequence([False] * 1000))
    assert n == 1 and saved == pytest.approx(1 - 2 / 1001)


def test_kinds_are_combinations_of_categories() -> None:
    """SMALL has one categorical variable, its fourth; THESIS has two, its last."""
    failures = np.array([[0.0, 0, 1, 2], [9, 90, 5, 2], [0, 0, 1, 0]])
    assert kinds_of(SMALL, failures) == 2 and kinds_of(SMALL, failures[:0]) == 0
    assert kinds(SMALL, failures) == set.union(*(kinds(SMALL, row[None]) for row in failures))
    points = np.zeros((4, 8))
    points[:, 6], points[:, 7] = [0, 0, 1, 1], [5, 5, 5, 6]
    assert kinds_of(THESIS, points) == 3


def test_the_thesis_space_has_8084_pairs() -> None:
    sizes = np.array(THESIS.sizes)
    assert (sizes.sum() ** 2 - (sizes**2).sum()) // 2 == 8084 == feasible_pairs(THESIS)
    assert pair_coverage(THESIS, THESIS.sample(1, np.random.default_rng(0))) == pytest.approx(
        28 / 8084
    )


def test_infeasible_pairs_are_not_required() -> None:
    space = Space(
        (
            Variable("a", "categorical", values=("x", "y")),
            Variable("b", "categorical", values=("x", "y")),
        ),
        (("a = x", "b = x"),),
    )
    assert feasible_pairs(space) == 3
    assert pair_coverage(space, np.array([[0.0, 0], [0, 1], [1, 0]])) == 1
    with pytest.raises(
        ValueError, match="1 points break a constraint, the first is point 1, which breaks clause 0"
    ):
        pair_coverage(space, np.array([[0.0, 0], [1, 1]]))
