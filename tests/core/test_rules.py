"""Rules describe the planted regions in readable words."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.rules import Condition, Rule, find_rule
from tests.spaces import SMALL, THESIS


def planted(box: Rule, seed: int = 0, count: int = 600) -> tuple[np.ndarray, np.ndarray]:
    points = THESIS.sample(count, np.random.default_rng(seed))
    return points, box.holds(points)


def test_a_planted_box_is_found_without_idle_conditions() -> None:
    points, failures = planted(Rule((Condition(1, 60, 100), Condition(3, -20, 0))))
    rule = find_rule(THESIS, points, failures, failures)
    assert {c.variable for c in rule.conditions} == {1, 3}
    inside = rule.holds(points)
    assert failures[inside].mean() > 0.85 and inside[failures].mean() > 0.85
    assert rule.text(THESIS).startswith("fog >= ") and "sun_altitude <= " in rule.text(THESIS)


def test_a_cyclic_interval_passes_through_north() -> None:
    points, failures = planted(Rule((Condition(2, 330, 30),)))
    rule = find_rule(THESIS, points, failures, failures)
    assert [c.variable for c in rule.conditions] == [2]
    assert rule.conditions[0].low == 330 and rule.conditions[0].high == 30
    assert rule.text(THESIS) == "sun_azimuth from 330 through 360 to 30 deg"


def test_a_category_is_named() -> None:
    points, failures = planted(Rule((Condition(6, values=(2,)),)))
    assert find_rule(THESIS, points, failures, failures).text(THESIS) == "animation = crouching"


@pytest.mark.parametrize(
    ("condition", "text"),
    [
        (Condition(0, 0, 4), "x <= 4 m"),
        (Condition(0, 6, 10), "x >= 6 m"),
        (Condition(0, 2, 3.5), "x in [2, 3.5] m"),
        (Condition(1, 300, 60), "angle from 300 through 360 to 60 deg"),
        (Condition(2, 2, 3), "count in [2, 3]"),
        (Condition(3, values=(0,)), "kind = a"),
        (Condition(3, values=(0, 2)), "kind in {a, c}"),
    ],
)
def test_text_of_a_condition(condition: Condition, text: str) -> None:
    assert Rule((condition,)).text(SMALL) == text


def test_the_empty_rule_holds_everywhere() -> None:
    assert Rule(()).holds(np.zeros((3, 4))).all()
    assert Rule(()).text(SMALL) == "every test"


def test_members_must_be_failures() -> None:
    points = SMALL.sample(3, np.random.default_rng(0))
    for failures, members in (([True, False, False], [False] * 3), ([True, False, False], [True, True, False])):
        with pytest.raises(ValueError, match="all of them must be failures"):
            find_rule(SMALL, points, np.array(failures), np.array(members))
