"""Model versions on the same tests: test by test and group by group (thesis section 7.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.statistics import mcnemar_p_value, mean_interval, one_against_several, sign_flip

Bools = NDArray[np.bool_]
Verdict = Literal["baseline", "better", "worse", "no difference shown"]


@dataclass(frozen=True, order=True)
class SequenceTest:
    """A test of a held-out sequence, the same for every version.

    scenario: name of the functional scenario. index: place in the sequence, from 0.

    >>> SequenceTest.named("F1star-00042")
    SequenceTest(scenario='F1star', index=42)
    """

    scenario: str
    index: int

    def __str__(self) -> str:
        """Its name: `F1star-00042`."""
        return f"{self.scenario}-{self.index:05d}"

    @staticmethod
    def named(name: str) -> SequenceTest:
        """The test of a name; ValueError if the text names no test."""
        scenario, _, index = name.rpartition("-")
        if not scenario or not index.isdecimal():
            raise ValueError(f"expected the name of a test, such as F1star-00042, got '{name}'")
        return SequenceTest(scenario, int(index))


@dataclass(frozen=True)
class SequenceOutcomes:
    """Outcomes of a version on a sequence, each (n,) bool in the order of the sequence.

    Args:
        valid: the simulation ended without an error.
        failed: the test fails; never true if it is not valid.
        by_ttc: the test fails by TTC alone.

    >>> failed = np.array([True, False, False])
    >>> outcomes = SequenceOutcomes(np.array([True, True, False]), failed, failed)
    >>> outcomes.tests, outcomes.errors, outcomes.failures, outcomes.rate
    (2, 1, 1, 0.5)
    """

    valid: Bools
    failed: Bools
    by_ttc: Bools

    @property
    def tests(self) -> int:
        """Number of valid tests."""
        return int(self.valid.sum())

    @property
    def errors(self) -> int:
        return len(self.valid) - self.tests

    @property
    def failures(self) -> int:
        return int(self.failed.sum())

    @property
    def rate(self) -> float:
        """Failures per valid test, in [0, 1], 0 without tests.

        It has no interval: the sequence is a covering array, not a random sample of the space, and
        a repeated test gives the same result to the last bit. To compare versions, use a paired
        test: its null hypothesis (either version fails a discordant test with equal probability)
        needs no random sample.
        """
        return self.failures / max(1, self.tests)

    def at(self, rows: Bools) -> SequenceOutcomes:
        """The outcomes of some of the tests; rows: (n,) bool."""
        return SequenceOutcomes(self.valid[rows], self.failed[rows], self.by_ttc[rows])


ROUNDING = 12**-0.5
"""Least spread of a count of failures over seeds: seeds with equal counts still vary.

A count is rounded to a whole test, and this is the standard deviation of a uniform rounding error.
"""


@dataclass(frozen=True)
class Interval:
    """A value and the limits of its confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class VersionDifference:
    """Two versions on the tests that are valid for both.

    fixed: (n,) bool, the tests that only the first version fails. regressed: (n,) bool, those that
    only the second fails. tests: number of valid ones. p_value: of the exact McNemar test.
    """

    fixed: Bools
    regressed: Bools
    tests: int
    p_value: float

    def verdict(self, alpha: float) -> Verdict:
        """The verdict on the second version; see `judge`."""
        return judge(int(self.fixed.sum()), int(self.regressed.sum()), self.p_value, alpha)


@dataclass(frozen=True)
class GroupDifference:
    """Two groups on the tests that are valid for all of their versions.

    difference: failures of the second minus those of the first, the mean over seeds.
    p_value: of an exact randomisation test over the tests, see `pair_groups`.
    """

    tests: int
    difference: Interval
    p_value: float


def judge(fixes: int, regressions: int, p_value: float, alpha: float) -> Verdict:
    """The verdict on a version against another, without correction for several comparisons.

    Args:
        fixes: number of tests that only the other version fails.
        regressions: number of tests that only this version fails.
        p_value: of the exact test of the difference.
        alpha: largest p-value at which a difference counts.

    >>> judge(9, 1, 0.021, 0.05)
    'better'
    """
    if p_value > alpha:
        return "no difference shown"
    return "better" if fixes > regressions else "worse"


def pair(before: SequenceOutcomes, after: SequenceOutcomes) -> VersionDifference:
    """Compare two versions test by test, on the tests that are valid for both.

    Args:
        before: outcomes of the first version.
        after: outcomes of the second version on the same sequence.

    >>> every = np.ones(3, bool)
    >>> first = SequenceOutcomes(every, np.array([True, True, False]), ~every)
    >>> second = SequenceOutcomes(every, np.array([False, True, False]), ~every)
    >>> pair(first, second).fixed.tolist()
    [True, False, False]
    """
    valid = before.valid & after.valid
    fixed, regressed = valid & before.failed & ~after.failed, valid & ~before.failed & after.failed
    p_value = mcnemar_p_value(int(fixed.sum()), int(regressed.sum()))
    return VersionDifference(fixed, regressed, int(valid.sum()), p_value)


def pair_groups(
    before: Sequence[SequenceOutcomes], after: Sequence[SequenceOutcomes], confidence: float
) -> GroupDifference:
    """Compare two groups of versions, one version a seed, in the same order of seeds.

    A single version, such as the base, is compared with each seed of the other group. The p-value
    is that of `sign_flip`, seeds summed, or, for a single version, of `one_against_several`: the
    base's outcome would count once for each seed, so its differences are not symmetric.

    Args:
        before: outcomes of the first group's versions.
        after: outcomes of the second group's versions, on the same sequence.
        confidence: of the interval of the difference, in (0, 1).

    Raises:
        ValueError: the groups differ in size, and neither is a single version.
    """
    if len(before) != len(after) and 1 not in (len(before), len(after)):
        raise ValueError(
            "expected groups of equally many versions or a single one, "
            f"got {len(before)} and {len(after)}"
        )
    valid = np.all([outcomes.valid for outcomes in (*before, *after)], axis=0)
    first = np.array([outcomes.failed[valid] for outcomes in before], dtype=np.int64)
    second = np.array([outcomes.failed[valid] for outcomes in after], dtype=np.int64)
    differences = second.sum(axis=1) - first.sum(axis=1)
    if len(first) == len(second):
        p_value = sign_flip((second - first).sum(axis=0))
    else:
        single, several = (first, second) if len(first) == 1 else (second, first)
        p_value = one_against_several(single[0], several.sum(axis=0), len(several))
    low, high = mean_interval(differences, confidence, least_spread=ROUNDING)
    difference = Interval(float(differences.mean()), low, high)
    return GroupDifference(int(valid.sum()), difference, p_value)


def group_failures(versions: Sequence[SequenceOutcomes], confidence: float) -> Interval:
    """Failures of a group: the mean over its versions with Student's interval.

    A single version has no interval, see `SequenceOutcomes.rate`.
    """
    counts = [outcomes.failures for outcomes in versions]
    return Interval(float(np.mean(counts)), *mean_interval(counts, confidence, limits=(0, np.inf)))
