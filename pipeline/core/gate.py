"""The gate that a model version must pass to become champion, and the choice of the champion."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipeline.core.comparison import Bools, SequenceOutcomes, pair
from pipeline.core.statistics import holm, paired_rise_limit

Measure = Literal["failures", "false activations"]
"""False activations are the failures of tests that ask not to brake."""
Judgement = Literal[
    "within the margin", "above the margin", "significantly worse", "too small to judge"
]


@dataclass(frozen=True)
class Policy:
    """The settings of a comparison.

    alpha: significance level of each paired test. confidence: of every interval and limit.
    margin: highest rise of a failure rate over the base's that the gate tolerates, as a share of
    the base's failure rate on the whole sequence.
    """

    alpha: float
    confidence: float
    margin: float


@dataclass(frozen=True)
class Part:
    """A part of the held-out tests: those of a scenario or of a named group.

    rows: (n,) bool, in the order of the sequence.
    """

    name: str
    measure: Measure
    rows: Bools


@dataclass(frozen=True)
class RiseLimit:
    """How far a version's failure rate may be above the base's on a part of the tests.

    tests: valid for both versions. fixes: number of tests that only the base fails.
    regressions: number of tests that only the version fails. p_value: of the exact McNemar test,
    two-sided, not corrected. limit: one-sided upper confidence limit of the rise, in [-1, 1]. It
    treats the tests as a sample of tests like these; the sequence is a designed list, so its
    confidence is nominal. judgement: `significantly worse` if the version has more failures and
    the p-value is significant, corrected for the number of parts; otherwise see `judge_limit`.
    """

    name: str
    measure: Measure
    tests: int
    fixes: int
    regressions: int
    p_value: float
    limit: float
    judgement: Judgement


@dataclass(frozen=True)
class Gate:
    """The gate's findings on a version.

    more_errors: than the base has. fewer: it fails significantly fewer tests of the whole sequence
    than the base. fewer_over_seeds: so do the versions that differ from it only by their seed, all
    together. limits: of every part.
    """

    more_errors: bool
    fewer: bool
    fewer_over_seeds: bool
    limits: tuple[RiseLimit, ...]

    def limits_that_are(self, judgement: Judgement) -> tuple[RiseLimit, ...]:
        return tuple(limit for limit in self.limits if limit.judgement == judgement)

    @property
    def passes(self) -> bool:
        """No more errors, fewer failures, also over the seeds, and no part in which it is worse.

        In no part may it be significantly worse or may its limit be above the margin. A part that
        is too small to judge does not hold the version back. The limits need no correction for
        their number: the version must keep all of them, so a version that truly exceeds the margin
        in a judged part passes with a probability of about 1 - confidence.
        """
        return (
            not self.more_errors
            and self.fewer
            and self.fewer_over_seeds
            and not self.limits_that_are("significantly worse")
            and not self.limits_that_are("above the margin")
        )


def judge_limit(limit: float, tests: int, allowed: float, confidence: float) -> Judgement:
    """Compare an upper limit with the rise that is allowed.

    A part is too small to judge if not even two versions with equal results on all its tests could
    keep to that rise. With 95 % confidence and an allowed rise of 10 points, these are parts of
    fewer than 25 tests.

    >>> judge_limit(0.12, tests=200, allowed=0.1, confidence=0.95)
    'above the margin'
    """
    if paired_rise_limit(0, 0, tests, confidence) > allowed:
        return "too small to judge"
    return "above the margin" if limit > allowed else "within the margin"


def limit_rises(
    base: SequenceOutcomes, version: SequenceOutcomes, parts: Sequence[Part], policy: Policy
) -> tuple[RiseLimit, ...]:
    """Judge the rise of the failure rate on each part of the tests.

    The significance tests of all parts are corrected together (Holm 1979), so that chance finds a
    difference in any part with a probability of at most `policy.alpha`.
    """
    allowed = policy.margin * base.rate
    differences = [pair(base.at(part.rows), version.at(part.rows)) for part in parts]
    differs = holm([difference.p_value for difference in differences], policy.alpha)
    limits = []
    for part, difference, significant in zip(parts, differences, differs, strict=True):
        tests = difference.tests
        fixes, regressions = int(difference.fixed.sum()), int(difference.regressed.sum())
        limit = paired_rise_limit(regressions, fixes, tests, policy.confidence)
        judgement = judge_limit(limit, tests, allowed, policy.confidence)
        if significant and regressions > fixes:
            judgement = "significantly worse"
        counted = (tests, fixes, regressions, difference.p_value)
        limits.append(RiseLimit(part.name, part.measure, *counted, limit, judgement))
    return tuple(limits)


def gate(
    base: SequenceOutcomes,
    version: SequenceOutcomes,
    fewer_over_seeds: bool,
    parts: Sequence[Part],
    policy: Policy,
) -> Gate:
    """Check whether a version may become champion; see `Gate`."""
    return Gate(
        more_errors=version.errors > base.errors,
        fewer=pair(base, version).verdict(policy.alpha) == "better",
        fewer_over_seeds=fewer_over_seeds,
        limits=limit_rises(base, version, parts, policy),
    )


def champion(outcomes: Mapping[str, SequenceOutcomes], passing: Collection[str]) -> str:
    """The version that passes the gate with the fewest failures, then the fewest by TTC alone.

    Args:
        outcomes: of every version by name, the base first.
        passing: names of the versions that pass the gate.

    Returns:
        The champion's name, judged on the tests that are valid for every version; the base if no
        version passes.
    """
    valid = np.all([version.valid for version in outcomes.values()], axis=0)

    def counts(name: str) -> tuple[int, int]:
        version = outcomes[name].at(valid)
        return version.failures, int(version.by_ttc.sum())

    candidates = [name for name in outcomes if name in passing]
    return min(candidates, key=counts, default=next(iter(outcomes)))
