"""The tables of thesis chapter 6 from our campaigns of `study=thesis`, beside the thesis' numbers.

    python -m benchmarks.grid keep        publish the campaigns that data/thesis holds
    python -m benchmarks.grid answer      all tables
    python -m benchmarks.grid summary     the table of docs/results/strategies.md

`python -m pipeline compose study=thesis && ./run search` executes the campaigns: six strategies of
the thesis and `forest` on F1 to F8, 1,000 tests each. A killed run is resumed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import kendalltau

from benchmarks.shared import RESULTS, markdown, pack, unpack
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.tables import read_tests
from pipeline.config.composing import PARAMS, load
from pipeline.config.schema import Config
from pipeline.core.measures import c_measure, failure_sequence, kinds_of, pair_coverage
from pipeline.core.statistics import mean_interval

PUBLISHED = RESULTS / "grid.csv"
THESIS = RESULTS / "grid-thesis.csv"
"""Tables 6.3 to 6.6: failures, tests saved (empty for n/a), shares of pairs that are covered."""
STRATEGIES = (
    "random",
    "pairwise",
    "evolutionary",
    "evolutionary_300",
    "linear",
    "network",
    "gaussian_process",
    "forest",
)
"""The order of the thesis; `forest` is ours alone."""
Cell = Callable[[pd.Series], str]
"""The text of a published campaign, or of a row of the thesis, in a table."""


def main() -> None:
    """Publish the campaigns, or print their tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("action", choices=["keep", "answer", "summary"])
    action = parser.parse_args().action
    if action == "keep":
        measured(load(PARAMS)).to_csv(PUBLISHED, index=False)
        return
    campaigns = with_saved(pd.read_csv(PUBLISHED))
    theirs = pd.read_csv(THESIS).assign(saved=lambda table: table["saved"].map(saved_text))
    tables = TABLES if action == "answer" else dict(list(TABLES.items())[:1])
    parts = [f"{head}\n\n{table(campaigns, theirs, cell)}" for head, cell in tables.items()]
    print("\n\n".join([*parts, order(campaigns, theirs)]))


def measured(config: Config, root: Path = Path()) -> pd.DataFrame:
    """A row for each campaign of a study that is finished: what it found in all its tests."""
    rows = []
    for path in Folders(config).searches:
        if not (root / path).exists():
            continue
        tests = read_tests(root / path)
        scenario, strategy = tests["scenario"].iloc[0], tests["strategy"].iloc[0]
        space = config.space(scenario)
        points, failed = encode_tests(tests, space), tests["failure"].to_numpy(bool)
        row = {"scenario": scenario, "strategy": strategy, "tests": len(tests)}
        row |= {"errors": int((tests["status"] != "ok").sum()), "failed": pack(failed)}
        row["kinds"] = kinds_of(space, points[failed])
        row["gamma_f"] = round(pair_coverage(space, points[failed]), 6)
        row["gamma_t"] = round(pair_coverage(space, points), 6)
        rows.append(row)
    if not rows:
        raise SystemExit(f"{Folders(config).root}: expected finished campaigns, got none")
    return pd.DataFrame(rows)


def with_saved(campaigns: pd.DataFrame) -> pd.DataFrame:
    """The campaigns with their failures, and the share of tests saved against random testing.

    The share is the thesis' C-measure, as text: `n/a` with fewer failures than random testing.
    """
    sequences = {}
    for row in campaigns.itertuples():
        failed = unpack(row.failed, row.tests)
        sequences[row.scenario, row.strategy] = failure_sequence(failed)
    failures, saved = [], []
    for scenario, strategy in zip(campaigns["scenario"], campaigns["strategy"], strict=True):
        sequence = sequences[scenario, strategy]
        failures.append(int(sequence[-1]))
        baseline = sequences.get((scenario, "random"))
        if strategy == "random" or baseline is None:
            saved.append("")
        else:
            saved.append(saved_text(c_measure(sequence, baseline)[1]))
    return campaigns.assign(failures=failures, saved=saved)


def saved_text(share: float | None) -> str:
    """A C-measure with two digits, or `n/a`."""
    return "n/a" if share is None or np.isnan(share) else f"{share:.2f}"


def table(campaigns: pd.DataFrame, theirs: pd.DataFrame, cell: Cell) -> str:
    """A row for each strategy, a column for each scenario: our text / the thesis' text."""
    ours = campaigns.set_index(["strategy", "scenario"])
    thesis = theirs.set_index(["strategy", "scenario"])
    scenarios = sorted(campaigns["scenario"].unique())
    rows = []
    for strategy in STRATEGIES:
        cells = []
        for scenario in scenarios:
            key = (strategy, scenario)
            text = cell(ours.loc[key]) if key in ours.index else ""
            theirs_text = cell(thesis.loc[key]) if key in thesis.index else ""
            if text and theirs_text:
                text = f"{text} / {theirs_text}"
            cells.append(text)
        if any(cells):
            rows.append([f"`{strategy}`", *cells])
    return markdown(["strategy", *scenarios], rows)


def order(campaigns: pd.DataFrame, theirs: pd.DataFrame) -> str:
    """How well the order of the thesis' strategies by failures agrees: Kendall's tau-b."""
    ours = campaigns.pivot(index="strategy", columns="scenario", values="failures")
    thesis = theirs.pivot(index="strategy", columns="scenario", values="failures")
    taus = [kendalltau(ours.loc[thesis.index, name], thesis[name])[0] for name in ours.columns]
    low, high = mean_interval(taus, limits=(-1, 1))
    return (
        f"Order of the thesis' {len(thesis)} strategies by failures: Kendall's τ "
        f"{np.mean(taus):.2f} ({low:.2f} to {high:.2f}), mean of {len(taus)} scenarios with "
        "Student's 95 % interval."
    )


TABLES: dict[str, Cell] = {
    "Failures in 1,000 tests (Tables 6.3 and 6.4), ours / the thesis':": (
        lambda row: f"{row['failures']:.0f}"
    ),
    "Share of tests saved against random testing, C (Table 6.5), ours / the thesis':": (
        lambda row: row["saved"]
    ),
    "Pairs that the failures cover, γ_f in % (Table 6.6), ours / the thesis':": (
        lambda row: f"{100 * row['gamma_f']:.1f}"
    ),
    "Pairs that the tests cover, γ_t in % (Table 6.6), ours / the thesis':": (
        lambda row: f"{100 * row['gamma_t']:.1f}"
    ),
    "Kinds of failures: different pairs of person and pose; the thesis has no such table:": (
        lambda row: f"{row['kinds']:.0f}" if "kinds" in row else ""
    ),
}


if __name__ == "__main__":
    main()
