"""Groups failures into regions.

Density proposes them, and a rule that gains more than its description costs decides.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.core.density import dense_groups, described_radius
from pipeline.core.descriptions import likelihood_gain
from pipeline.core.regions import NOISE
from pipeline.core.rule_search import FoundRule, find_rule
from pipeline.core.rules import Bools, Rule
from pipeline.core.space import Floats, Space
from pipeline.core.words import Word

EVERYWHERE = 0.95
"""Share of failures from which they are one region: too few tests pass to separate regions."""
MIXED = "mixed"
"""The cause of a region whose failures have several."""
BLOCKS = 5
"""Number of blocks of consecutive tests that are held back in turn.

Consecutive tests depend on each other if a strategy chose them, so no single ones are held back.
"""
MIN_GAIN = 3.0
"""Nats that a rule must gain beyond its own description.

With labels at random, the chance of a false region is then about e^-3 = 5 %.
"""


@dataclass(frozen=True)
class Outcomes:
    """All tests of a space. points: (n, d). failed: (n,). words: that rules may use."""

    space: Space
    points: Floats
    failed: Bools
    words: tuple[Word, ...] = ()

    def __post_init__(self) -> None:
        if self.points.shape != (len(self.failed), len(self.space)):
            raise ValueError(
                f"points must be ({len(self.failed)}, {len(self.space)}), got {self.points.shape}"
            )

    def rule(self, members: Bools) -> FoundRule:
        """The rule that separates the failures `members`, (n,), from passing tests.

        Other failures count for neither side.
        """
        rows = members | ~self.failed
        return find_rule(self.space, self.points[rows], members[rows], self.words)

    def gain(self, candidate: FoundRule, members: Bools) -> float:
        """The gain of a rule for separating the failures `members`, (n,), from passing tests."""
        rows = members | ~self.failed
        inside = candidate.rule.holds(self.points[rows])
        hits = inside & members[rows]
        gain = likelihood_gain(np.array(hits.sum()), np.array(inside.sum()), members[rows])
        return float(gain) - candidate.price


@dataclass(frozen=True)
class Group:
    """A region.

    cause: of its failures, `MIXED` for several. members: (n,) bool, its failures. rule: separates
    them from passing tests.
    """

    cause: str
    members: Bools
    rule: Rule


def group_failures(
    tests: Outcomes, causes: NDArray[np.str_], neighbours: float, min_failures: int
) -> list[Group]:
    """The failure regions, larger ones first; failures in none of them are isolated.

    Each cause has its own regions; failures that are left over are grouped once more, whatever
    their causes. If (nearly) every test fails, all failures are one region.

    Args:
        tests: all tests of a space.
        causes: (n,) of each test.
        neighbours: see `described_radius`.
        min_failures: smallest number of failures of a region.
    """
    if len(tests.failed) and tests.failed.mean() >= EVERYWHERE:
        return [Group(MIXED, tests.failed, Rule(()))] if tests.failed.sum() >= min_failures else []
    left, groups = tests.failed.copy(), []
    for cause in (*np.unique(causes[tests.failed]).tolist(), MIXED):
        wanted = left if cause == MIXED else left & (causes == cause)
        for group in _of_cause(cause, tests, wanted, neighbours, min_failures):
            groups.append(group)
            left = left & ~group.members
    return sorted(groups, key=lambda group: -int(group.members.sum()))


def held_back(tests: Outcomes, group: Group) -> tuple[int, int]:
    """Tests and failures inside rules for a region that are fitted without these tests.

    The tests, in the order in which they were executed, are cut into `BLOCKS`; the rule that the
    others give is judged on each block in turn. The region was found with all tests, so this is
    no independent sample.
    """
    inside = np.zeros(len(tests.failed), bool)
    for block in np.array_split(np.arange(len(inside)), BLOCKS):
        others = np.ones(len(inside), bool)
        others[block] = False
        rest = replace(tests, points=tests.points[others], failed=tests.failed[others])
        rule = rest.rule(group.members[others]).rule
        if rule.conditions or not group.rule.conditions:
            inside[block] = rule.holds(tests.points[block])
    return int(inside.sum()), int((inside & tests.failed).sum())


def _of_cause(
    cause: str, tests: Outcomes, failures: Bools, neighbours: float, min_failures: int
) -> Iterator[Group]:
    """The regions of a cause.

    The density clusters of the failures, and all of them together, propose rules. The best rule
    takes the failures that it admits, and the search goes on with the others until no rule gains
    `MIN_GAIN`.
    """
    left = failures
    while left.sum() >= min_failures:
        # Density alone proves nothing, so each rule is scored on all remaining failures.
        rules = [tests.rule(seed) for seed in _seeds(tests, left, neighbours, min_failures)]
        gains = [tests.gain(candidate, left) for candidate in rules]
        best = int(np.argmax(gains))
        if gains[best] < MIN_GAIN:
            return
        rule = rules[best].rule
        members = left & rule.holds(tests.points)
        if members.sum() < min_failures:
            return
        # Fitted again, because failures outside no longer affect its bounds.
        refitted = tests.rule(members).rule
        yield Group(cause, members, refitted if refitted.conditions else rule)
        left = left & ~members


def _seeds(tests: Outcomes, left: Bools, neighbours: float, min_failures: int) -> Iterator[Bools]:
    """The failures that are left, (n,), and their density clusters."""
    yield left
    radius = described_radius(tests.space, int(left.sum()), neighbours)
    labels = np.full(len(left), NOISE, np.int64)
    labels[left] = dense_groups(tests.space, tests.points[left], radius, min_failures)
    yield from (labels == label for label in range(int(labels.max(initial=NOISE)) + 1))
