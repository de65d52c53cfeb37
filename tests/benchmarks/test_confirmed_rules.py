"""The answer about confirmed rules: intervals and counts by hand."""

from __future__ import annotations

import json
from pathlib import Path

import confirmed_rules
import pandas as pd


def rules() -> pd.DataFrame:
    conditions = json.dumps([{"variable": "x", "text": "child"}])
    found = {"scenario": "F1", "tests_inside": 10, "failures_inside": 9, "conditions": conditions}
    return pd.DataFrame([{"seed": 0, **found}, {"seed": 0, **found, "scenario": "F2"}, {"seed": 0, **found}])


def test_a_rate_outside_of_its_interval_is_counted() -> None:
    # Clopper and Pearson: 20 of 40 gives 0.338 to 0.662.
    stated = {"seed": 0, "stated_tests": 40, "stated_failures": 20, "check_tests": 120}
    failures = {0: 60, 1: 30, 2: 60}  # The last rule is the first one again, and counts once.
    outcomes = pd.DataFrame([{**stated, "number": number, "check_failures": count} for number, count in failures.items()])
    text = confirmed_rules.answer(rules(), outcomes)
    assert "lies in the stated interval for 1 of 2 rules. The precision in the search's own tests lies in it for 0." in " ".join(
        text.split()
    )
    assert "| 0 | F1 | Children | 90% | 34% to 66% | 50% | yes |" in text
    assert "| 0 | F2 | Children | 90% | 34% to 66% | 25% | no |" in text


def test_a_seed_that_is_executed_again_replaces_its_rows(tmp_path: Path) -> None:
    path = tmp_path / "confirmed.csv"
    for seed, failures in ((1, 3), (0, 4), (1, 5)):
        confirmed_rules.publish(seed, [{"seed": seed, "number": 0, "stated_failures": failures}], path)
    assert pd.read_csv(path).to_numpy().tolist() == [[0, 0, 4], [1, 0, 5]]
