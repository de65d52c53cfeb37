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
    """One test of a held-out sequence, the same for every version: its scenario and its place in the sequence, from 0."""

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
    """The outcomes of one version on a sequence, each (n,) bool in the order of the sequence.

    valid: the simulation ended without an error. failed: the test fails; never true if it is not valid. by_ttc: it fails by TTC alone.
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

        It has no interval: the sequence is a covering array, a designed set and no random sample of the space, and a repeated test gives
        the same result to the last bit. Whether two versions differ on these tests is a paired test's question, whose null hypothesis
        (either version fails a discordant test with equal probability) does not need a random sample.
        """
        return self.failures / max(1, self.tests)

    def at(self, rows: Bools) -> SequenceOutcomes:
        """The outcomes of some of the tests; rows: (n,) bool."""
        return SequenceOutcomes(self.valid[rows], self.failed[rows], self.by_ttc[rows])


ROUNDING = 12**-0.5
"""Standard deviation of what a count of failures leaves out, a uniform part of one test: seeds that count the same still vary."""


@dataclass(frozen=True)
class Interval:
    """A value and the limits of its confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class VersionDifference:
    """Two versions on the tests that are valid for both.

    fixed, regressed: (n,) bool, the tests that only the first and only the second version fails. p_value: of the exact McNemar test.
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

    difference: failures of the second minus those of the first, the mean over seeds. p_value: of an exact randomisation test over the
    tests, see `pair_groups`.
    """

    tests: int
    difference: Interval
    p_value: float


def judge(fixes: int, regressions: int, p_value: float, alpha: float) -> Verdict:
    """The verdict on a version against another: a difference counts if its exact p-value is at most alpha, without correction for several
    comparisons.

    fixes, regressions: number of tests that only the other, and only this version fails.
    """
    if p_value > alpha:
        return "no difference shown"
    return "better" if fixes > regressions else "worse"


def pair(before: SequenceOutcomes, after: SequenceOutcomes) -> VersionDifference:
    """Compare two versions test by test."""
    valid = before.valid & after.valid
    fixed, regressed = valid & before.failed & ~after.failed, valid & ~before.failed & after.failed
    return VersionDifference(
        fixed, regressed, int(valid.sum()), mcnemar_p_value(int(fixed.sum()), int(regressed.sum()))
    )


def pair_groups(
    before: Sequence[SequenceOutcomes], after: Sequence[SequenceOutcomes], confidence: float
) -> GroupDifference:
    """Compare two groups of versions, one version per seed, in the same order of seeds; a single version, such as the base, is compared
    with each seed.

    The p-value is that of `sign_flip`, seeds summed, or of `one_against_several` for a single version: the base's outcome would count once
    for each seed, so its differences are not symmetric.
    """
    if len(before) != len(after) and 1 not in (len(before), len(after)):
        raise ValueError(
            f"expected groups of equally many versions or a single one, got {len(before)} and {len(after)}"
        )
    valid = np.all([outcomes.valid for outcomes in (*before, *after)], axis=0)
    first, second = (
        np.array([outcomes.failed[valid] for outcomes in group], dtype=np.int64)
        for group in (before, after)
    )
    differences = second.sum(axis=1) - first.sum(axis=1)
    if len(first) == len(second):
        p_value = sign_flip((second - first).sum(axis=0))
    else:
        one, several = (first, second) if len(first) == 1 else (second, first)
        p_value = one_against_several(one[0], several.sum(axis=0), len(several))
    difference = Interval(
        float(differences.mean()), *mean_interval(differences, confidence, least_spread=ROUNDING)
    )
    return GroupDifference(int(valid.sum()), difference, p_value)


def group_failures(versions: Sequence[SequenceOutcomes], confidence: float) -> Interval:
    """Failures of a group: the mean over its versions with Student's interval; a single version has no interval, see
    `SequenceOutcomes.rate`."""
    counts = [outcomes.failures for outcomes in versions]
    return Interval(float(np.mean(counts)), *mean_interval(counts, confidence, limits=(0, np.inf)))
