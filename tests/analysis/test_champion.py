"""The alias `champion` moves only to a version that was compared with its holder, on the same tests, and is better."""

from __future__ import annotations

import pandas as pd
import pytest

from pipeline.analysis.comparison import compare
from pipeline.tracking.champion import better, successor
from tests.analysis.test_compare import compared, held_out, table

BASE = "c" * 20 + "." * 20
FEW = "c" * 8 + "." * 32
FEWER = "c" * 7 + "." * 33
FEWEST = "c" + "." * 39


@pytest.mark.parametrize(
    ("holder", "versions", "taken", "why"),
    [
        ("base", {"base": BASE, "adaptive": FEW}, "adaptive", "moves from base to adaptive"),
        ("adaptive", {"base": BASE, "adaptive": FEW}, None, "stays with adaptive"),
        ("base", {"base": BASE, "adaptive": BASE}, None, "stays with base"),
        # One failure fewer is not significant, eight are.
        ("random", {"base": BASE, "random": FEW, "adaptive": FEWER}, None, "adaptive does not fail significantly less than it"),
        ("random", {"base": BASE, "random": FEW, "adaptive": FEWEST}, "adaptive", "moves from random to adaptive"),
        ("adaptive", {"base": BASE, "random": FEWEST, "adaptive": FEW}, "random", "moves from adaptive to random"),
        # A holder that more tests show to be no better loses it, to the base if no version is better.
        ("adaptive", {"base": BASE, "adaptive": BASE}, "base", "as adaptive is held back: not significantly fewer"),
        ("random", {"base": BASE, "random": BASE, "adaptive": FEW}, "adaptive", "as random is held back"),
        (
            None,
            {"base": BASE, "adaptive": FEWEST},
            None,
            "set base.weights to its folder",
        ),
    ],
)
def test_successor(holder: str | None, versions: dict[str, str], taken: str | None, why: str) -> None:
    version, reason = successor(compared(**versions), holder)
    assert version == taken and why in reason


def test_a_version_that_is_worse_on_one_scenario_is_not_better() -> None:
    first = {"base": "c" * 20, "random": "c" * 15 + "." * 5, "adaptive": "." * 20}
    second = {"base": "c" * 20, "random": "." * 20, "adaptive": "c" * 6 + "." * 14}
    tests = pd.concat([table(first), table(second).assign(scenario="F2star")])
    result = compare(held_out(tests), "digest", [], alpha=0.05, confidence=0.95)
    assert not better(result, "adaptive", "random") and not better(result, "random", "adaptive")
    assert better(result, "adaptive", "base")
