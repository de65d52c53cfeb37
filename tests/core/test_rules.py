"""Rules in readable words."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.rules import Condition, Rule
from tests.spaces import SMALL, THESIS


@pytest.mark.parametrize(
    ("condition", "text"),
    [
        (Condition(0, 0, 4), "x <= 4 m"),
        (Condition(0, 6, 10), "x >= 6 m"),
        (Condition(0, 2, 3.5), "x in [2, 3.5] m"),
        (Condition(1, 300, 60), "angle from 300 through 360 to 60 deg"),
        (Condition(2, 2, 3), "count in [2, 3]"),
        (Condition(2, 3, 3), "count = 3"),
        (Condition(3, values=(0, 1), text="early"), "early"),
        (Condition(0, -3, 3, other=0, sign=-1), "x - x in [-3, 3] m"),
        (Condition(0, 12, 20, other=0, sign=1), "x + x >= 12 m"),
        (Condition(3, values=(0,)), "kind = a"),
        (Condition(3, values=(0, 2)), "kind in {a, c}"),
    ],
)
def test_text_of_a_condition(condition: Condition, text: str) -> None:
    assert Rule((condition,)).text(SMALL) == text


def test_the_empty_rule_holds_everywhere() -> None:
    assert Rule(()).holds(np.zeros((3, 4))).all()
    assert Rule(()).text(SMALL) == "every test"


def test_words_form_a_phrase_in_the_order_of_their_declaration() -> None:
    child, crouching = (
        Condition(7, values=(1,), text="child", order=3),
        Condition(6, values=(2,), text="crouching", order=1),
    )
    rule = Rule((Condition(0, 40, 100), child, crouching))
    assert rule.text(THESIS) == "crouching child and rain >= 40 %"


def test_an_interval_admits_both_of_its_bounds_also_across_the_ends_of_a_circle() -> None:
    values = np.array([59.9, 60, 60.1, 299.9, 300, 300.1])
    assert Condition(1, 60, 300).admits(values).tolist() == [False, True, True, True, True, False]
    assert Condition(1, 300, 60).admits(values).tolist() == [True, True, False, False, True, True]
