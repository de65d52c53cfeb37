"""Splits, grows and merges failure regions along their rules, so that one cause is one region."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.regions import NOISE, find_regions, largest_first
from pipeline.core.rules import Rule, find_rule
from pipeline.core.space import Floats, Space

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
ROUNDS = 4
SHRINK = 0.85
"""Factor on the radius each time a cluster is split."""
SMALLEST = 0.3
"""Share of the first radius below which a cluster without a rule is not split further."""
EVERYWHERE = 0.95
"""Share of failures among all tests from which all failures are one region: too few tests pass to tell regions apart."""


@dataclass(frozen=True)
class PointOutcomes:
    """All tests of a space. points: (n, d). failures: (n,) whether each test failed."""

    space: Space
    points: Floats
    failures: Bools

    def __post_init__(self) -> None:
        if self.points.shape != (len(self.failures), len(self.space)):
            raise ValueError(f"points must be ({len(self.failures)}, {len(self.space)}), got {self.points.shape}")

    def rule(self, members: Bools) -> Rule:
        """The rule of the failures `members`, (n,)."""
        return find_rule(self.space, self.points, self.failures, members)

    def precision(self, rule: Rule) -> float:
        """Share of failures among the tests under a rule, 0 without tests."""
        inside = rule.holds(self.points)
        return float(self.failures[inside].mean()) if inside.any() else 0.0


def readable_regions(tests: PointOutcomes, radius: float, min_precision: float, min_failures: int) -> Ints:
    """Failure regions with a rule each: density clusters, split if no rule holds, grown and merged if one does.

    radius: of the first clusters, on the mixed distance. min_precision: smallest share of failures among the tests under a rule.
    min_failures: of a region. Returns (n,) region of each failure, larger regions first, -1 for failures without a region.

    If (nearly) every test fails, all failures are one region: density and rules describe what sets failures apart from passing tests.
    """
    if len(tests.failures) and tests.failures.mean() >= EVERYWHERE:
        return largest_first(np.where(tests.failures, 0, NOISE), min_failures)
    labels = split_regions(tests, radius, min_precision, min_failures)
    labels = grow_regions(tests, labels, min_precision, min_failures)
    return merge_regions(tests, labels, min_precision)


def split_regions(tests: PointOutcomes, radius: float, min_precision: float, min_failures: int) -> Ints:
    """Density clusters of the failures, split by smaller radii while no precise rule describes them.

    Arguments as for `readable_regions`. Two adjacent causes form one dense cluster at any radius that finds the thinner of them, but no
    rule holds for both.
    """
    labels = np.full(len(tests.points), NOISE, np.int64)
    waiting = [(np.flatnonzero(tests.failures), radius)]
    found: list[Ints] = []
    while waiting:
        members, size = waiting.pop()
        clusters = find_regions(tests.space, tests.points[members], size, min_failures)
        for label in range(int(clusters.max(initial=NOISE)) + 1):
            part = members[clusters == label]
            if size * SHRINK < radius * SMALLEST or _precise(tests, part, min_precision):
                found.append(part)
            else:
                waiting.append((part, size * SHRINK))
    for label, part in enumerate(found):
        labels[part] = label
    return largest_first(labels, min_failures)


def _precise(tests: PointOutcomes, members: NDArray[Any], min_precision: float) -> bool:
    """Whether a rule describes the failures `members`, a mask or indices."""
    chosen = np.zeros(len(tests.points), bool)
    chosen[members] = True
    rule = tests.rule(chosen)
    return bool(rule.conditions) and tests.precision(rule) >= min_precision


def grow_regions(tests: PointOutcomes, labels: Ints, min_precision: float, min_failures: int) -> Ints:
    """Assign each failure that a region's rule covers to that region; returns (n,) labels, larger regions first, -1 for none.

    labels: (n,), region of each failure, -1 for none. min_precision: only rules with at least this share of failures among their tests take
    in failures. min_failures: smaller regions are dissolved.

    The mixed distance includes variables that do not matter for a failure, so density alone splits one cause into several clusters and
    misses its thin parts; the rules of these clusters still agree. From the largest region on, each region takes in the failures that its
    rule covers and its rule is computed again, until nothing changes.
    """
    grown = labels.copy()
    for label in range(int(labels.max(initial=NOISE)) + 1):
        for _ in range(ROUNDS):
            members = grown == label
            if not members.any():
                break
            rule = tests.rule(members)
            if not rule.conditions or tests.precision(rule) < min_precision:
                break
            taken = rule.holds(tests.points) & tests.failures & ((grown > label) | (grown == NOISE))
            if not taken.any():
                break
            grown[taken] = label
    return largest_first(grown, min_failures)


def merge_regions(tests: PointOutcomes, labels: Ints, min_precision: float) -> Ints:
    """Join regions that one rule describes; arguments and labels as for `grow_regions`."""
    merged = labels.copy()
    for label in range(int(labels.max(initial=NOISE)) + 1):
        for other in range(label + 1, int(labels.max(initial=NOISE)) + 1):
            both = (merged == label) | (merged == other)
            if (merged == label).any() and (merged == other).any() and _precise(tests, both, min_precision):
                merged[both] = label
    return largest_first(merged)
