"""Intervals and paired tests against published or hand-computed values."""

from __future__ import annotations

from itertools import product
from math import comb

import numpy as np
import pytest
from scipy.stats import binom

from pipeline.core.statistics import (
    censored_mean,
    mcnemar,
    mean_interval,
    one_against_several,
    paired_rise_limit,
    sign_flip,
    wilson_interval,
)


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
    assert (paired.fixes, paired.regressions) == (6, 1)
    # Two-sided binomial: 2 * (1 + 7) / 2^7.
    assert paired.p_value == pytest.approx(0.125)


def test_mcnemar_of_equal_versions_and_unequal_lists() -> None:
    assert mcnemar([True, False], [True, False]).p_value == 1
    with pytest.raises(ValueError, match="equal length"):
        mcnemar([True], [True, False])


@pytest.mark.parametrize(
    ("regressions", "fixes", "tests", "low", "high"),
    # Fagerland, Lydersen & Laake 2017, chapter 8: Tango's 95 % intervals of Bentur et al. 2009 and
    # Cavo et al. 2012.
    [(1, 7, 21, -0.5172, -0.0260), (6, 16, 161, -0.1240, -0.0054)],
)
def test_the_rise_limits_of_published_tables(
    regressions: int, fixes: int, tests: int, low: float, high: float
) -> None:
    assert paired_rise_limit(regressions, fixes, tests, 0.975) == pytest.approx(high, abs=5e-5)
    # The lower limit is the upper one of the reverse comparison.
    assert -paired_rise_limit(fixes, regressions, tests, 0.975) == pytest.approx(low, abs=5e-5)


def test_the_rise_limit_without_discordant_tests_and_at_its_ends() -> None:
    z2 = 1.6448536**2
    assert paired_rise_limit(0, 0, 40, 0.95) == pytest.approx(z2 / (40 + z2))
    # With regressions alone, it is the upper end of Wilson's interval of their share.
    assert paired_rise_limit(5, 0, 10, 0.975) == pytest.approx(wilson_interval(5, 10)[1])
    assert paired_rise_limit(0, 40, 40, 0.95) == pytest.approx((z2 - 40) / (z2 + 40))
    assert paired_rise_limit(3, 0, 3, 0.95) == paired_rise_limit(0, 0, 0, 0.95) == 1


def test_the_rise_limit_refuses_impossible_counts() -> None:
    with pytest.raises(
        ValueError, match="regressions and fixes must be counts among 10 tests, got 6 and 5"
    ):
        paired_rise_limit(6, 5, 10, 0.95)
    with pytest.raises(ValueError, match=r"confidence must be in \(0, 1\), got 1"):
        paired_rise_limit(1, 1, 10, 1)


@pytest.mark.parametrize("tests", [30, 60])
def test_the_rise_limit_has_its_nominal_coverage(tests: int) -> None:
    """Over every possible outcome, weighted by its probability: what a simulation approaches."""
    outcomes = [
        (regressions, fixes)
        for regressions in range(tests + 1)
        for fixes in range(tests + 1 - regressions)
    ]
    limits = {outcome: paired_rise_limit(*outcome, tests, 0.95) for outcome in outcomes}
    for up, down in [(0.1, 0.0), (0.1, 0.05), (0.1, 0.1), (0.05, 0.2), (0.3, 0.2), (0.2, 0.4)]:
        held = 0.0
        for (regressions, fixes), limit in limits.items():
            neither = tests - regressions - fixes
            ways = comb(tests, regressions) * comb(tests - regressions, fixes)
            held += (
                (limit >= up - down)
                * ways
                * up**regressions
                * down**fixes
                * (1 - up - down) ** neither
            )
        # Counts are whole numbers, so no method hits 0.95 everywhere. A two-sided limit would hold
        # in 0.975 of cases.
        assert 0.925 < held < 0.97


def test_sign_flip_is_mcnemar_for_two_versions_and_counts_all_signs_for_more() -> None:
    before, after = (
        np.array([1] * 9 + [0] * 11, bool),
        np.array([0] * 8 + [1] + [0] * 8 + [1] * 3, bool),
    )
    assert sign_flip(after.astype(int) - before) == pytest.approx(mcnemar(before, after).p_value)
    differences = np.array([3, -1, 2, 0, 2, 1, -3, 2])
    signs = np.array(list(product((-1, 1), repeat=len(differences))))
    assert sign_flip(differences) == pytest.approx(
        np.mean(np.abs(signs @ differences) >= abs(differences.sum()))
    )
    assert sign_flip(np.zeros(5, int)) == sign_flip(np.array([], int)) == 1
    with pytest.raises(ValueError, match="whole numbers"):
        sign_flip(np.array([0.5]))


def test_one_against_several_is_mcnemar_for_one_other_version() -> None:
    before, after = [1, 1, 1, 1, 0, 0, 1], [0, 0, 0, 0, 0, 1, 1]
    assert one_against_several(before, after, 1) == pytest.approx(mcnemar(before, after).p_value)


def test_one_against_several_counts_each_place_of_the_one() -> None:
    # One failure among three versions: the one has it with a chance of 1/3. Expected: 2/3, so 2 is
    # the only sum as far away.
    assert one_against_several([1, 1], [0, 0], 2) == pytest.approx(1 / 9)
    # 0 is 2/3 away, and only 2 is as far or farther.
    assert one_against_several([0, 0], [1, 1], 2) == pytest.approx(4 / 9 + 1 / 9)
    assert one_against_several([1, 0], [2, 0], 2) == 1


def test_one_against_several_is_no_more_often_significant_than_it_says() -> None:
    rng, alpha = np.random.default_rng(0), 0.05
    failed = rng.random((400, 6, 20)) < 0.9
    p_values = [one_against_several(each[0], each[1:].sum(axis=0), 5) for each in failed]
    flips = [sign_flip((each[1:].astype(int) - each[0]).sum(axis=0)) for each in failed]
    exact = binom.sf(np.sum(np.array(p_values) <= alpha) - 1, 400, alpha)
    too_often = binom.sf(np.sum(np.array(flips) <= alpha) - 1, 400, alpha)
    assert exact > 0.01 > too_often, (
        "the differences from one version are not symmetric, so their signs must not be flipped"
    )


@pytest.mark.parametrize("others", [[1], [3, 0], [-1, 0]])
def test_one_against_several_refuses_impossible_counts(others: list[int]) -> None:
    with pytest.raises(ValueError, match="lists of equal length, with counts in"):
        one_against_several([1, 0], others, 2)


def test_the_censored_mean_by_hand() -> None:
    # Kaplan-Meier: 1 until 1, 3/4 until 3 (2 is censored), 3/8 until 5, the largest: 1 + 2 * 3/4 +
    # 2 * 3/8.
    mean = censored_mean([1, 2, 3, 5], [True, False, True, False])
    assert mean.value == pytest.approx(3.25) and mean.censored == 2
    assert mean.low < 3.25 < mean.high


def test_without_censoring_it_is_the_plain_mean() -> None:
    values = [3.0, 8.0, 2.0, 2.0]
    mean = censored_mean(values, [True] * 4)
    assert (mean.value, mean.low, mean.high) == pytest.approx(
        (3.75, *mean_interval(values, limits=(0, np.inf)))
    )
    single = censored_mean([7], [True])
    assert (single.value, single.low, single.high, single.censored) == (7, 7, 7, 0)


def test_censoring_at_one_budget_gives_the_mean_of_what_was_spent() -> None:
    mean, spent = censored_mean([3, 80, 80, 17], [True, False, False, True]), [3, 80, 80, 17]
    assert (mean.value, mean.low, mean.high) == pytest.approx(
        (45, *mean_interval(spent, limits=(0, 80)))
    )


def test_if_all_are_censored_the_mean_is_a_bound() -> None:
    mean = censored_mean([80, 60], [False, False])
    assert (mean.value, mean.low, mean.high, mean.censored) == (80, 80, 80, 2)


@pytest.mark.parametrize(
    ("values", "reached"), [([], []), ([1, 2], [True]), ([-1], [True]), ([np.inf], [False])]
)
def test_the_censored_mean_refuses_other_values(values: list[float], reached: list[bool]) -> None:
    with pytest.raises(ValueError, match="finite numbers from 0 and as many flags"):
        censored_mean(values, reached)


def test_the_limits_of_a_restricted_mean_do_not_exceed_its_largest_value() -> None:
    mean = censored_mean([10, 100, 100], [True, False, False])
    assert (mean.value, mean.high) == (70, 100)
