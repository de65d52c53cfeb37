"""Intervals and paired tests against published or hand-computed values."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from pipeline.core.statistics import mcnemar, mean_interval, sign_flip, wilson_interval


def test_wilson_interval_of_known_proportions() -> None:
    assert wilson_interval(5, 10) == pytest.approx((0.2366, 0.7634), abs=1e-4)
    assert wilson_interval(0, 10) == pytest.approx((0, 0.2775), abs=1e-4)
    assert wilson_interval(10, 10)[1] == 1
    assert wilson_interval(0, 0) == (0, 1)


def test_wilson_interval_refuses_impossible_counts() -> None:
    with pytest.raises(ValueError, match=r"successes must be in \[0, 10\], got 11"):
        wilson_interval(11, 10)
    with pytest.raises(ValueError, match=r"confidence must be in \(0, 1\), got 1"):
        wilson_interval(1, 10, 1.0)


def test_mean_interval_is_students() -> None:
    # t(0.975, 3) = 3.1824; the standard deviation of the four is sqrt(62 / 9).
    half = 3.18245 * np.sqrt(6.916667) / 2
    assert mean_interval([3.0, 4, 5, 9]) == pytest.approx((5.25 - half, 5.25 + half), abs=1e-3)
    assert mean_interval([2.0]) == (2, 2)
    assert mean_interval([1.0, 9], limits=(0, 40)) == (0, 40)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_mean_interval_has_its_nominal_coverage(count: int) -> None:
    samples = np.random.default_rng(0).normal(10, 2, (2000, count))
    held = [low <= 10 <= high for low, high in map(mean_interval, samples)]
    assert np.mean(held) == pytest.approx(0.95, abs=0.015)


def test_mean_interval_refuses_non_finite_values() -> None:
    for values in ([], [1.0, np.nan]):
        with pytest.raises(ValueError, match="one or more finite numbers"):
            mean_interval(values)


def test_mcnemar_counts_discordant_tests() -> None:
    before = [True] * 7 + [False] * 3
    after = [True] * 1 + [False] * 6 + [True] + [False] * 2
    paired = mcnemar(before, after)
    assert (paired.both, paired.fixes, paired.regressions, paired.neither) == (1, 6, 1, 2)
    # Two-sided binomial: 2 * (1 + 7) / 2^7.
    assert paired.p_value == pytest.approx(0.125)
    assert (paired.tests, paired.change) == (10, -5)


def test_mcnemar_of_equal_versions_and_unequal_lists() -> None:
    assert mcnemar([True, False], [True, False]).p_value == 1
    with pytest.raises(ValueError, match="equal length"):
        mcnemar([True], [True, False])


def test_sign_flip_is_mcnemar_for_two_versions_and_counts_all_signs_for_more() -> None:
    before, after = np.array([1] * 9 + [0] * 11, bool), np.array([0] * 8 + [1] + [0] * 8 + [1] * 3, bool)
    assert sign_flip(after.astype(int) - before) == pytest.approx(mcnemar(before, after).p_value)
    differences = np.array([3, -1, 2, 0, 2, 1, -3, 2])
    signs = np.array(list(product((-1, 1), repeat=len(differences))))
    assert sign_flip(differences) == pytest.approx(np.mean(np.abs(signs @ differences) >= abs(differences.sum())))
    assert sign_flip(np.zeros(5, int)) == sign_flip(np.array([], int)) == 1
    with pytest.raises(ValueError, match="whole numbers"):
        sign_flip(np.array([0.5]))
