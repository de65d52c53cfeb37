"""The benchmark of planted regions: shares are shares, and its tables by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmarks import regions


def test_shares_of_failures_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two rules over four tests: three of five tests in their own rules fail, six of ten later."""
    monkeypatch.setattr(regions, "held_back", lambda tests, group: (5, 3))
    tests: Any = SimpleNamespace(points=None, failed=np.array([True, True, False, False]))
    groups: Any = []
    for inside in ([True, False, True, False], [True, True, True, False]):
        rule = SimpleNamespace(holds=lambda points, inside=inside: np.array(inside))
        groups.append(SimpleNamespace(rule=rule))
    assert regions.precisions(tests, groups) == (3 / 5, 6 / 10)
    assert np.isnan(regions.precisions(tests, [])).all()


def test_planted_and_random_worlds_have_a_table_each() -> None:
    planted = {"world": "two boxes", "tests": 400, "seeds": 5, "found": 4}
    planted |= dict.fromkeys(regions.MEASURES, 0.504)
    random = {"world": "random, 0.05", "tests": 400, "seeds": 20, "found": 3, "confirmed": 1.0}
    lines = regions.shown(pd.DataFrame([planted, random])).splitlines()
    assert lines[2] == f"| two boxes | 400 | 4 / 5 |{' 0.50 |' * len(regions.MEASURES)}"
    assert lines[-1] == "| 0.05 | 20 | 3 | 1 |"


@pytest.mark.parametrize(("first", "second", "share"), [("110", "011", 1 / 3), ("000", "000", 1)])
def test_overlap_is_intersection_over_union(first: str, second: str, share: float) -> None:
    sets = [pd.Series(list(bits)).eq("1").to_numpy() for bits in (first, second)]
    assert regions.overlap(*sets) == share
