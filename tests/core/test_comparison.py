"""The comparison of versions on boolean vectors, by hand-computed cases."""

from __future__ import annotations

import re

import pytest

from pipeline.core.comparison import (
    SequenceTest,
    group_failures,
    judge,
    pair,
    pair_groups,
)
from tests.core.outcomes import outcomes


def test_the_name_of_a_test_is_read_back() -> None:
    test = SequenceTest("F-2-star", 42)
    assert str(test) == "F-2-star-00042" and SequenceTest.named(str(test)) == test
    assert str(SequenceTest("F", 123456)) == "F-123456"


@pytest.mark.parametrize("name", ["", "F1star", "F1star-", "-00001", "F1star-1.5", "F1star-x"])
def test_a_text_that_names_no_test_is_refused(name: str) -> None:
    message = f"expected the name of a test, such as F1star-00042, got '{name}'"
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        SequenceTest.named(name)


def test_errors_count_for_neither_version_of_a_pair() -> None:
    difference = pair(outcomes("ccc.e"), outcomes("c.ec."))
    assert (difference.fixed.tolist(), difference.regressed.tolist()) == (
        [False, True, *[False] * 3],
        [*[False] * 3, True, False],
    )
    assert (difference.tests, difference.p_value) == (3, 1.0)


@pytest.mark.parametrize(
    ("fixes", "regressions", "p_value", "verdict"),
    [
        (6, 0, 0.03125, "better"),
        (0, 6, 0.03125, "worse"),
        (5, 0, 0.0625, "no difference shown"),
        (3, 1, 0.05, "better"),
    ],
)
def test_a_difference_counts_up_to_alpha(
    fixes: int, regressions: int, p_value: float, verdict: str
) -> None:
    assert judge(fixes, regressions, p_value, 0.05) == verdict


def test_rate_and_group_failures() -> None:
    assert outcomes("cf......ee").rate == 0.25 and outcomes("ee").rate == 0
    single = group_failures([outcomes("cf......ee")], 0.95)
    assert (single.value, single.low, single.high) == (2, 2, 2)
    mean = group_failures([outcomes("cc.."), outcomes("cccc")], 0.95)
    # t(0.975, 1) = 12.706; no count is below 0.
    assert (mean.value, mean.low, mean.high) == pytest.approx((3, 0, 15.706), abs=1e-3)


def test_groups_are_paired_by_seed() -> None:
    difference = pair_groups(
        [outcomes("cccc.e"), outcomes("cccc.e")], [outcomes("....cc"), outcomes("c....c")], 0.95
    )
    # The last test is an error with one version. Differences by seed: -3 and -3; by test, summed:
    # -1, -2, -2, -2, 1.
    assert (difference.tests, difference.difference.value) == (5, -3)
    # Sums of the 32 sign patterns at least as far as 6: +-8 twice; +-6, by flipping one of the two
    # ones, four times.
    assert difference.p_value == 6 / 32


def test_a_single_version_is_compared_with_each_seed() -> None:
    base, versions = [outcomes("cccc.e")], [outcomes("....cc"), outcomes("c....c")]
    difference = pair_groups(base, versions, 0.95)
    assert (difference.tests, difference.difference.value) == (5, -3)
    # The base fails each test with a chance of 2, 1, 1, 1 and 1 in 3: 4 of 5 failures are 2 more
    # than expected. As far away are 0 and 5.
    none, four, five = 2**4, 2 * 4 * 2 + 1, 2
    assert difference.p_value == pytest.approx((none + four + five) / 3**5)
    assert pair_groups(versions, base, 0.95).p_value == difference.p_value


def test_groups_of_different_sizes_cannot_be_paired() -> None:
    with pytest.raises(
        ValueError, match="expected groups of equally many versions or a single one, got 2 and 3"
    ):
        pair_groups([outcomes("c")] * 2, [outcomes("c")] * 3, 0.95)


def test_equal_differences_of_several_seeds_are_equal_as_counts_alone() -> None:
    several = pair_groups([outcomes("cccc")] * 2, [outcomes("c...")] * 2, 0.95).difference
    half = (
        12.7062 / 12**0.5 / 2**0.5
    )  # t quantile of one degree of freedom, standard deviation of rounding.
    assert (several.value, several.low, several.high) == pytest.approx(
        (-3, -3 - half, -3 + half), abs=1e-4
    )
    single = pair_groups([outcomes("cccc")], [outcomes("c...")], 0.95).difference
    assert single.value == single.low == single.high == -3
