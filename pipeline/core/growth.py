"""Lets failure regions grow along their rules, so that one cause is one region."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.core.regions import NOISE
from pipeline.core.rules import find_rule
from pipeline.core.space import Floats, Space

Ints = NDArray[np.int64]
ROUNDS = 4


def grow_regions(space: Space, points: Floats, failures: NDArray[np.bool_], labels: Ints, min_precision: float, min_failures: int) -> Ints:
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
    return _largest_first(grown, min_failures)


def _largest_first(labels: Ints, min_failures: int) -> Ints:
    known, counts = np.unique(labels[labels != NOISE], return_counts=True)
    known, counts = known[counts >= min_failures], counts[counts >= min_failures]
    result = np.full(len(labels), NOISE, dtype=np.int64)
    for rank, label in enumerate(known[np.argsort(-counts, kind="stable")]):
        result[labels == label] = rank
    return result
