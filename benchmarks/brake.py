"""Base failure rates of F1 to F8 by threshold, and of a car that holds its speed.

    python -m benchmarks.brake run        48 campaigns of 60 random tests, 40 minutes
    python -m benchmarks.brake keep       publish the campaigns that `run` executed
    python -m benchmarks.brake rates      failures by threshold
    python -m benchmarks.brake cruise     failures and KPI of both kinds of cruise control

All other settings are those of `study=thesis`. A killed run is resumed.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.shared import RESULTS, markdown
from pipeline.artefacts.tables import read_tests
from pipeline.core.statistics import wilson_interval

PUBLISHED = RESULTS / "brake.csv"
FOLDER = Path("data/brake")
SCENARIOS = tuple(f"F{number}" for number in range(1, 9))
THRESHOLDS = (0.8, 0.5, 0.25, 0.1, 0.05)
TESTS = 60
SHARES = (0.05, 0.25, 0.5, 0.75, 1.0)
"""Quantiles of the KPI."""


def main() -> None:
    """Run the campaigns, publish them or print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("action", choices=["run", "keep", "rates", "cruise"])
    action = parser.parse_args().action
    if action == "run":
        run()
    elif action == "keep":
        measured().to_csv(PUBLISHED, index=False)
    else:
        print({"rates": rates, "cruise": cruise}[action](pd.read_csv(PUBLISHED)))


def campaigns() -> Iterator[tuple[str, str, float]]:
    """Scenario, cruise control and threshold of each campaign."""
    for scenario in SCENARIOS:
        yield scenario, "keep", THRESHOLDS[0]
        for threshold in THRESHOLDS:
            yield scenario, "hold", threshold


def run() -> None:
    """Execute every campaign that is not finished."""
    for scenario, kind, threshold in campaigns():
        words = [f"scenario={scenario}", "strategy=random", f"budget={TESTS}", "seed=0"]
        words += [f"out={folder(scenario, kind, threshold)}", f"detector.threshold={threshold}"]
        words += [f"vehicle.cruise={kind}", "campaign.match_iou=0.3"]
        subprocess.run([sys.executable, "-m", "pipeline", "campaign", *words], check=True)


def folder(scenario: str, kind: str, threshold: float) -> Path:
    """Where a campaign lies."""
    return FOLDER / f"{scenario}-{kind}-{threshold:g}"


def measured() -> pd.DataFrame:
    """A row for each campaign: its failures by mode, and quantiles of the KPI, seconds."""
    rows = []
    for scenario, kind, threshold in campaigns():
        tests = read_tests(folder(scenario, kind, threshold) / "tests.parquet")
        valid = tests[tests["status"] == "ok"]
        row = {"scenario": scenario, "cruise": kind, "threshold": threshold, "tests": len(valid)}
        row["failures"] = int(valid["failure"].sum())
        for mode in ("contact", "late", "false_positives"):
            row[mode] = int((valid["failure_mode"] == mode).sum())
        row["lost"] = int((valid["cause"] == "lost_after_detection").sum())
        for share in SHARES:
            row[f"kpi_{share:g}"] = round(float(np.quantile(valid["adj_ttc_s"], share)), 3)
        rows.append(row)
    return pd.DataFrame(rows)


def rates(published: pd.DataFrame) -> str:
    """Failures of each scenario by threshold, and their rate over all scenarios."""
    held = published[published["cruise"] == "hold"]
    failures = held.pivot(index="threshold", columns="scenario", values="failures")
    rows = []
    for threshold in THRESHOLDS:
        counts = failures.loc[threshold]
        tests = int(held.loc[held["threshold"] == threshold, "tests"].sum())
        low, high = wilson_interval(int(counts.sum()), tests)
        rate = f"{100 * counts.sum() / tests:.1f} ({100 * low:.1f} to {100 * high:.1f})"
        false = int(held.loc[held["threshold"] == threshold, "false_positives"].sum())
        rows.append((threshold, *counts, rate, false))
    names = ("threshold", *SCENARIOS, "%", "false positives alone")
    return markdown(names, rows)


def cruise(published: pd.DataFrame) -> str:
    """Failures of all scenarios, and quartiles of the KPI, at the first threshold."""
    chosen = published[published["threshold"] == THRESHOLDS[0]]
    rows = []
    for kind, tests in chosen.groupby("cruise", sort=False):
        row = [f"`{kind}`", tests["failures"].sum(), tests["lost"].sum()]
        for scenario in ("F2", "F8"):
            (test,) = tests[tests["scenario"] == scenario].to_dict("records")
            row.append("–".join(f"{test[f'kpi_{share:g}']:.2f}" for share in SHARES[1:4]))
        rows.append(row)
    heads = ("failures", "lost after detection", "KPI on F2, s", "KPI on F8, s")
    return markdown(("cruise control", *heads), rows)


if __name__ == "__main__":
    main()
