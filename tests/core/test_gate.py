"""The gate and the champion on boolean vectors, by hand-computed cases."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.gate import (
    Gate,
    Judgement,
    Part,
    Policy,
    champion,
    gate,
    judge_limit,
    limit_rises,
)
from pipeline.core.statistics import wilson_interval
from tests.core.outcomes import outcomes

POLICY = Policy(alpha=0.05, confidence=0.95, margin=0.2)
"""Allows a rise by a tenth over `BASE`, which fails half the tests."""
ALL = Part("all", "failures", np.ones(60, bool))
BASE = outcomes("c" * 30 + "." * 30)


def judged(version: str, over_seeds: bool = True, *parts: Part) -> Gate:
    return gate(BASE, outcomes(version), over_seeds, parts or (ALL,), POLICY)


def test_a_version_without_failures_passes() -> None:
    judgement = judged("." * 60)
    assert judgement.passes and [limit.judgement for limit in judgement.limits] == [
        "within the margin"
    ]


def test_more_errors_hold_a_version_back() -> None:
    judgement = judged("e" + "." * 59)
    assert judgement.more_errors and not judgement.passes
    assert gate(outcomes("e" * 2 + "c" * 58), outcomes("." * 59 + "e"), True, (), POLICY).passes, (
        "as many or fewer errors do not"
    )


def test_a_difference_that_is_not_significant_holds_a_version_back() -> None:
    judgement = judged("." * 5 + "c" * 25 + "." * 30)
    assert not judgement.fewer and not judgement.passes
    assert judged("." * 6 + "c" * 24 + "." * 30).passes


def test_the_other_seeds_hold_a_version_back() -> None:
    assert not judged("." * 60, False).passes


def test_a_limit_above_the_margin_holds_a_version_back() -> None:
    second = Part("second half", "failures", np.arange(60) >= 30)
    judgement = judged("." * 30 + "c" + "." * 29, True, ALL, second)
    # One regression of 30 without a fix: the upper end of Wilson's interval of 1/30, 13.6 %;
    # one-sided 95 % are two-sided 90 %.
    (limit,) = judgement.limits_that_are("above the margin")
    assert (limit.name, limit.tests, limit.fixes, limit.regressions) == ("second half", 30, 0, 1)
    assert (
        limit.limit == pytest.approx(wilson_interval(1, 30, 0.9)[1])
        and judgement.fewer
        and not judgement.passes
    )
    assert judged("." * 60, True, ALL, second).passes


def test_a_part_that_is_too_small_holds_nothing_back() -> None:
    judgement = judged("." * 56 + "c" * 4, True, ALL, Part("few", "failures", np.arange(60) >= 50))
    assert judgement.limits_that_are("too small to judge")[0].regressions == 4 and judgement.passes


@pytest.mark.parametrize(
    ("tests", "limit", "judgement"),
    # z² / (24 + z²) = 10.13 %, z² / (25 + z²) = 9.77 %.
    [
        (24, -0.5, "too small to judge"),
        (25, -0.5, "within the margin"),
        (25, 0.1, "within the margin"),
        (25, 0.1001, "above the margin"),
        (0, 1, "too small to judge"),
    ],
)
def test_a_limit_is_judged_where_equal_results_could_meet_the_margin(
    tests: int, limit: float, judgement: Judgement
) -> None:
    assert judge_limit(limit, tests, 0.1, 0.95) == judgement


def test_a_limit_counts_the_tests_that_are_valid_for_both() -> None:
    part = Part("all", "failures", np.ones(5, bool))
    (judgement,) = limit_rises(outcomes("cc.e."), outcomes(".ecc."), [part], POLICY)
    assert (judgement.tests, judgement.fixes, judgement.regressions) == (3, 1, 1)


def test_the_champion_fails_least_on_the_tests_that_all_executed() -> None:
    versions = {
        "base": outcomes("cccc"),
        "one": outcomes("c..e"),
        "two": outcomes("f..c"),
        "three": outcomes("cc.."),
    }
    # The last test counts for no version: one and two fail once each, two by false positives.
    assert champion(versions, ["one", "two", "three"]) == "two"
    assert champion(versions, ["one", "three"]) == "one"
    assert champion(versions, []) == "base"


def test_an_error_of_a_version_that_is_held_back_counts_for_no_champion() -> None:
    versions = {
        "base": outcomes("cccc"),
        "two": outcomes(".c.."),
        "one": outcomes("c..."),
        "held back": outcomes("e..."),
    }
    assert champion(versions, ["two", "one"]) == "one", "without the first test, one never fails"


def test_a_limit_has_the_confidence_of_the_policy_and_not_that_of_its_tests() -> None:
    policy = Policy(alpha=0.05, confidence=0.8, margin=0.2)
    (judgement,) = limit_rises(BASE, outcomes("c" * 31 + "." * 29), [ALL], policy)
    assert judgement.limit == pytest.approx(wilson_interval(1, 60, 0.6)[1]), (
        "one-sided 80 % are two-sided 60 %"
    )
