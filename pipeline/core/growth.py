"""Splits, grows and merges failure regions along their rules, so that one cause is one region."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.regions import NOISE, find_regions, largest_first
from pipeline.core.rules import find_rule
from pipeline.core.space import Floats, Space

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
ROUNDS = 4
SHRINK = 0.85
"""Of the radius, each time that a cluster is split."""
SMALLEST = 0.3
"""Share of the first radius at which a cluster without a rule is left as it is."""


def readable_regions(space: Space, points: Floats, failures: Bools, radius: float, min_precision: float, min_failures: int) -> Ints:
    """Failure regions that a rule describes: density clusters, split where no rule holds, grown and merged where one does.

    points, failures: (n, d) and (n,), all tests. radius: of the first clusters, on the mixed distance. min_precision: share of the tests
    under a rule that must fail. Returns (n,) region of each failure, larger regions first, -1 for the others.
    """
    labels = split_regions(space, points, failures, radius, min_precision, min_failures)
    labels = grow_regions(space, points, failures, labels, min_precision, min_failures)
    return merge_regions(space, points, failures, labels, min_precision)


def split_regions(space: Space, points: Floats, failures: Bools, radius: float, min_precision: float, min_failures: int) -> Ints:
    """Density clusters of the failures, each split by a smaller radius while no precise rule describes it.

    Arguments as of `readable_regions`. Two causes that meet are one dense cluster at any radius that finds the thinner of them, but no
    rule holds for both.
    """
    labels = np.full(len(points), NOISE, np.int64)
    waiting = [(np.flatnonzero(failures), radius)]
    found: list[Ints] = []
    while waiting:
        members, size = waiting.pop()
        clusters = find_regions(space, points[members], size, min_failures)
        for label in range(int(clusters.max(initial=NOISE)) + 1):
            part = members[clusters == label]
            if size * SHRINK < radius * SMALLEST or _precise(space, points, failures, part, min_precision):
                found.append(part)
            else:
                waiting.append((part, size * SHRINK))
    for label, part in enumerate(found):
        labels[part] = label
    return largest_first(labels, min_failures)


def _precise(space: Space, points: Floats, failures: Bools, members: NDArray[Any], min_precision: float) -> bool:
    """Whether a rule describes the failures `members`, a mask or indices."""
    chosen = np.zeros(len(points), bool)
    chosen[members] = True
    rule = find_rule(space, points, failures, chosen)
    return bool(rule.conditions) and bool(failures[rule.holds(points)].mean() >= min_precision)


def grow_regions(space: Space, points: Floats, failures: Bools, labels: Ints, min_precision: float, min_failures: int) -> Ints:
    """Give each failure that a region's rule covers to that region; returns (n,) labels, larger regions first, -1 for none.

    points, failures: (n, d) and (n,), all tests. labels: (n,), region of each failure, -1 for the others. min_precision: only rules
    under which at least this share of the tests fails take failures in. min_failures: what is left with fewer is no region any more.

    The mixed distance counts variables that have nothing to do with a failure, so density alone breaks one cause into several clusters
    and leaves its thin parts out; their rules still agree. From the largest region on, each takes in what its rule covers, and the rule
    is found again, until nothing changes.
    """
    grown = labels.copy()
    for label in range(int(labels.max(initial=NOISE)) + 1):
        for _ in range(ROUNDS):
            members = grown == label
            if not members.any():
                break
            rule = find_rule(space, points, failures, members)
            inside = rule.holds(points)
            if not rule.conditions or not inside.any() or failures[inside].mean() < min_precision:
                break
            taken = inside & failures & ((grown > label) | (grown == NOISE))
            if not taken.any():
                break
            grown[taken] = label
    return largest_first(grown, min_failures)


def merge_regions(space: Space, points: Floats, failures: Bools, labels: Ints, min_precision: float) -> Ints:
    """Join regions for which one rule holds as well; arguments and labels as of `grow_regions`."""
    merged = labels.copy()
    for label in range(int(labels.max(initial=NOISE)) + 1):
        for other in range(label + 1, int(labels.max(initial=NOISE)) + 1):
            both = (merged == label) | (merged == other)
            if (merged == label).any() and (merged == other).any() and _precise(space, points, failures, both, min_precision):
                merged[both] = label
    return largest_first(merged)
