"""The alias `champion` moves only to a version that is better than its holder on the same tests."""

from __future__ import annotations

import pytest

from pipeline.tracking.champion import fails_less, successor
from tests.analysis.comparisons import compared, compared_on, scenarios

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
        (
            "random",
            {"base": BASE, "random": FEW, "adaptive": FEWER},
            None,
            "adaptive does not fail significantly less than it",
        ),
        (
            "random",
            {"base": BASE, "random": FEW, "adaptive": FEWEST},
            "adaptive",
            "moves from random to adaptive",
        ),
        (
            "adaptive",
            {"base": BASE, "random": FEWEST, "adaptive": FEW},
            "random",
            "moves from adaptive to random",
        ),
        # A holder that the gate holds back keeps the alias, except against a better version.
        (
            "adaptive",
            {"base": BASE, "adaptive": BASE},
            None,
            "less than it (adaptive is held back: not significantly fewer failures",
        ),
        (
            "random",
            {"base": BASE, "random": BASE, "adaptive": FEW},
            "adaptive",
            "moves from random to adaptive",
        ),
        # The base takes it from a version that fails significantly more.
        ("adaptive", {"base": FEW, "adaptive": BASE}, "base", "moves from adaptive to base"),
        (
            None,
            {"base": BASE, "adaptive": FEWEST},
            None,
            "set base.weights to its folder",
        ),
    ],
)
def test_successor(
    holder: str | None, versions: dict[str, str], taken: str | None, why: str
) -> None:
    version, reason = successor(compared(**versions), holder)
    assert version == taken and why in reason


def test_a_version_that_the_gate_holds_back_takes_the_alias_from_nobody() -> None:
    """It fails least in all, but may be worse on F2*."""
    first = {"base": "c" * 40, "random": "c" * 30 + "." * 10, "adaptive": "." * 40}
    second = {"base": "." * 40, "random": "." * 40, "adaptive": "c" * 6 + "." * 34}
    result = compared_on(scenarios(F1star=first, F2star=second))
    assert fails_less(result, "adaptive", "random") and not fails_less(result, "random", "adaptive")
    assert not result.passes("adaptive") and successor(result, "random") == (
        None,
        "champion stays with random",
    )
    assert successor(result, "base")[0] == "random"


def test_versions_that_were_not_compared_are_refused() -> None:
    with pytest.raises(ValueError, match="expected both adaptive and control in the comparison"):
        fails_less(compared(base=BASE, adaptive=FEW), "adaptive", "control")
