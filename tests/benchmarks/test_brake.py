"""Base rates by threshold and cruise control: the tables, by hand."""

from __future__ import annotations

import pandas as pd

from benchmarks import brake


def published() -> pd.DataFrame:
    """Every campaign has ten tests; one fails per step of the threshold, by a false positive."""
    rows = []
    for scenario, kind, threshold in brake.campaigns():
        failures = brake.THRESHOLDS.index(threshold)
        row = {"scenario": scenario, "cruise": kind, "threshold": threshold, "tests": 10}
        row |= {"failures": failures, "false_positives": failures, "lost": int(kind == "hold")}
        rows.append({**row, **{f"kpi_{share:g}": 1 + share for share in brake.SHARES}})
    return pd.DataFrame(rows)


def test_rates_are_those_of_the_car_that_holds_its_speed() -> None:
    lines = brake.rates(published()).splitlines()
    assert lines[2] == "| 0.8 | 0 | 0 | 0 | 0 | 0 | 0 | 0 | 0 | 0.0 (0.0 to 4.6) | 0 |"
    assert lines[-1] == "| 0.05 | 4 | 4 | 4 | 4 | 4 | 4 | 4 | 4 | 40.0 (30.0 to 51.0) | 32 |"


def test_cruise_controls_stand_side_by_side() -> None:
    *_, keep, hold = brake.cruise(published()).splitlines()
    assert keep == "| `keep` | 0 | 0 | 1.25–1.50–1.75 | 1.25–1.50–1.75 |"
    assert hold == "| `hold` | 0 | 8 | 1.25–1.50–1.75 | 1.25–1.50–1.75 |"
