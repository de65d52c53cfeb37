"""The benchmark of planted regions: shares are shares, and its tables by hand."""

from __future__ import annotations

import pandas as pd
import pytest

from benchmarks import regions
from tests.planted import WORLDS


def test_rules_of_a_planted_world_are_precise_in_their_own_and_in_held_back_tests() -> None:
    tests = WORLDS["two boxes"].outcomes(0)
    precision, held_back = regions.precisions(tests, regions.grouped(tests))
    assert precision == 1 and 0.9 < held_back <= 1


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
