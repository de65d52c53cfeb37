"""The answer about confirmed rules: intervals and counts by hand."""

from __future__ import annotations

import json
from pathlib import Path

import confirmed_rules
import pandas as pd
import pytest


def rules() -> pd.DataFrame:
    conditions = json.dumps([{"variable": "x", "text": "child"}])
    found = {"scenario": "F1", "tests_inside": 10, "failures_inside": 9, "conditions": conditions}
    return pd.DataFrame(
        [{"seed": 0, **found}, {"seed": 0, **found, "scenario": "F2"}, {"seed": 0, **found}]
    )


def test_a_rate_outside_of_its_interval_is_counted() -> None:
    # Clopper and Pearson: 20 of 40 gives 0.338 to 0.662.
    stated = {"seed": 0, "stated_tests": 40, "stated_failures": 20, "check_tests": 120}
    known = rules().drop_duplicates()[
        ["scenario", "conditions"]
    ]  # The last rule is the first one again, and counts once.
    outcomes = known.assign(**stated, check_failures=[60, 30])
    text = confirmed_rules.answer(rules(), outcomes)
    assert (
        "lies in the stated interval for 1 of 2 rules. The precision in the search's own tests lies in it for 0."
        in " ".join(text.split())
    )
    assert "| 0 | F1 | Children | 90% | 34% to 66% | 50% | yes |" in text
    assert "| 0 | F2 | Children | 90% | 34% to 66% | 25% | no |" in text


def test_a_seed_that_is_executed_again_replaces_its_rows(tmp_path: Path) -> None:
    path = tmp_path / "confirmed.csv"
    for seed, failures in ((1, 3), (0, 4), (1, 5)):
        confirmed_rules.publish(seed, [{"seed": seed, "stated_failures": failures}], path)
    assert pd.read_csv(path).to_numpy().tolist() == [[0, 4], [1, 5]]


def test_outcomes_of_a_rule_that_another_search_found_are_refused() -> None:
    outcomes = (
        rules()
        .head(1)
        .assign(
            scenario="F3", stated_tests=40, stated_failures=20, check_tests=120, check_failures=60
        )
    )
    with pytest.raises(SystemExit, match="1 of 1 rules are not in"):
        confirmed_rules.answer(rules(), outcomes)
