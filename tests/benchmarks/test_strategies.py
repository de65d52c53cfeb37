"""Strategies in the analytic world and the thesis' grid: campaigns, and their tables by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks import grid, strategies
from benchmarks.shared import pack, unpack
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.tables import write_tests
from pipeline.config.composing import compose
from tests.analysis.fabricated import make_tests


def campaign(strategy: str, seed: int, failures: int) -> dict[str, object]:
    """A published campaign whose first tests fail."""
    row: dict[str, object] = {"strategy": strategy, "seed": seed, "tests": 1000, "cpu_s": 2.0}
    row["failed"] = pack(np.arange(1000) < failures)
    for budget in strategies.BUDGETS:
        row |= {f"kinds_{budget}": 4, f"gamma_f_{budget}": 0.25}
    return row


def test_outcomes_are_read_as_they_were_written() -> None:
    failed = np.random.default_rng(0).random(37) < 0.5
    assert np.array_equal(unpack(pack(failed), 37), failed)


def test_a_campaign_is_scored_after_each_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(strategies, "TESTS", 40)
    monkeypatch.setattr(strategies, "BUDGETS", (20, 40))
    row = strategies.campaign(("pairwise", 3), [])
    failed = unpack(row["failed"], 40)
    assert 0 < failed.sum() < 40 and row["tests"] == 40 and row["cpu_s"] > 0
    assert 0 < row["kinds_20"] <= row["kinds_40"] <= failed.sum()
    assert 0 < row["gamma_f_20"] <= row["gamma_f_40"] < 40 * 28 / 8084


def test_a_new_campaign_replaces_the_one_of_its_strategy_and_seed(tmp_path: Path) -> None:
    path = tmp_path / "strategies.csv"
    for strategy, seed, failures in (("b", 0, 1), ("a", 1, 2), ("a", 0, 3), ("a", 1, 4)):
        strategies.publish(campaign(strategy, seed, failures), path)
    table = strategies.scored(pd.read_csv(path))
    columns = table[["strategy", "seed", "failures_300"]].to_numpy().tolist()
    assert columns == [["a", 0, 3], ["a", 1, 4], ["b", 0, 1]]


def test_means_over_seeds_by_hand() -> None:
    rows = [campaign("few", 0, 1), campaign("few", 1, 3)]
    rows += [campaign("many", 0, 400), campaign("many", 1, 400)]
    first, second = strategies.answer(pd.DataFrame(rows)).splitlines()[2:]
    assert first.startswith("| `many` | 2 | 300 (300 to 300) | 4 (4 to 4) | 25 (25 to 25) | 400 (")
    # Failures 1 and 3: mean 2, standard error 1, t quantile 12.7.
    assert second.startswith("| `few` | 2 | 2 (-11 to 15) | ") and second.endswith(" | 2.0 |")
    assert strategies.choose(pd.DataFrame(rows)).splitlines()[2] == "| `many` | 300 | 4 | 25 % |"


def cells(text: str, strategy: str) -> list[list[str]]:
    """The cells of a strategy's row in each table."""
    lines = [line for line in text.splitlines() if line.startswith(f"| `{strategy}`")]
    return [line.strip("| ").split(" | ")[1:] for line in lines]


def test_the_grid_stands_beside_the_thesis() -> None:
    rows = []
    for strategy, failing in (("random", (3,)), ("evolutionary", (1, 2, 5)), ("forest", ())):
        row: dict[str, object] = {"scenario": "F5", "strategy": strategy, "tests": 40, "kinds": 1}
        rows.append({**row, "failed": pack(np.isin(np.arange(40), failing))})
    campaigns = grid.with_saved(pd.DataFrame(rows).assign(gamma_f=0.02, gamma_t=0.5))
    thesis = [("F5", "evolutionary", 24, 0.93, 0.022, 0.572), ("F5", "random", 0, np.nan, 0, 0.787)]
    names = ["scenario", "strategy", "failures", "saved", "gamma_f", "gamma_t"]
    theirs = pd.DataFrame(thesis, columns=names)
    theirs["saved"] = theirs["saved"].map(grid.saved_text)
    tables = [grid.table(campaigns, theirs, cell) for cell in grid.TABLES.values()]
    # The first failure after 2 tests instead of 4.
    expected = [["3 / 24"], ["0.50 / 0.93"], ["2.0 / 2.2"], ["50.0 / 57.2"], ["1"]]
    assert cells("\n".join(tables), "evolutionary") == expected
    assert cells(tables[1], "random") == [] and cells(tables[1], "forest") == [["n/a"]]
    assert "thesis' 2 strategies by failures: Kendall's τ 1.00 (" in grid.order(campaigns, theirs)
    theirs["failures"] = [0, 5]
    assert "τ -1.00 (" in grid.order(campaigns, theirs)


def test_campaigns_of_a_study_are_measured(tmp_path: Path) -> None:
    config = compose("thesis", ["search=[F1]", "campaign.tests=40"])
    space = config.space("F1")
    path = next(path for path in Folders(config).searches if "/random/" in path)
    keys = {"scenario": "F1", "strategy": "random", "version": "base", "seed": 0}
    tests = make_tests(space, keys, space.sample(40, np.random.default_rng(0)), 30.0)
    (tmp_path / path).parent.mkdir(parents=True)
    write_tests(tmp_path / path, tests, space)
    (row,) = grid.measured(config, tmp_path).to_dict("records")
    failures = int(tests["failure"].sum())
    assert unpack(row["failed"], 40).sum() == failures > 0
    assert 0 < row["kinds"] <= failures and 0 < row["gamma_f"] < row["gamma_t"]
    with pytest.raises(SystemExit, match="expected finished campaigns, got none"):
        grid.measured(config, tmp_path / "elsewhere")
