"""What became of the people and poses that the base set shows rarely."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.analysis.failure_regions import cluster
from pipeline.analysis.planted import Searched
from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.failure_counts import Count
from pipeline.artefacts.model_card import read_card, write_card
from pipeline.artefacts.results import read
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.artefacts.tables import read_tests
from pipeline.config.composing import compose
from pipeline.core.space import Space
from pipeline.report.verdict import planted_rows, verdict_table
from pipeline.scenarios.people import person
from tests.analysis.fabricated import FabricatedStudy, make_tests


def test_the_group_that_was_rare_is_counted_in_the_searches_and_in_the_held_out_tests(
    tmp_path: Path,
) -> None:
    study = FabricatedStudy(tmp_path).make_analysed()
    card = read_card(study.cards[0])
    training = {**card.training, "rare_children": 0.15, "rare_crouching": 1.0}
    write_card(study.cards[0], card.model_copy(update={"training": training}))
    study.run("compare")
    comparison = read(study.root / "comparison.json", Comparison)
    (planted,) = comparison.planted
    assert (planted.group, planted.frequency) == ("children", 0.15)
    searched = pd.concat(map(read_tests, study.search_tests))
    children = searched[
        searched["blueprint"].map(lambda name: person(name).child) & (searched["status"] == "ok")
    ]
    expected = children.groupby("strategy")["failure"].agg(["size", "sum"])
    assert planted.searched == {
        name: Count(tests=row["size"], failures=row["sum"]) for name, row in expected.iterrows()
    }
    for path in study.held_out_tests:
        rows = read_tests(path)
        rows = rows[
            rows["blueprint"].map(lambda name: person(name).child) & (rows["status"] == "ok")
        ]
        assert planted.held_out[path.parts[-3]] == Count(
            tests=len(rows), failures=int(rows["failure"].sum())
        )
    rows = planted_rows(comparison)
    assert rows[:2] == [("group", "children"), ("frequency", "0.15")] and len(rows) == 9
    assert [name for name, _ in rows[2:5]] == [
        "search, random",
        "search, mixed",
        "named by regions",
    ]
    assert "Planted blind spots" in verdict_table(comparison)
    named = planted.model_copy(update={"regions": ("F1 region 1", "F1 region 3", "F2 region 1")})
    assert ("named by regions", "F1: 1, 3; F2: 1") in planted_rows(
        comparison.model_copy(update={"planted": (named,)})
    )


def test_a_searched_scenario_without_the_group_has_no_tests_of_it() -> None:
    space, rng = compose("default", []).space("F1"), np.random.default_rng(0)
    still = Space(tuple(v for v in space.variables if v.name not in ("animation", "blueprint")))
    tests = [
        make_tests(
            of,
            {"scenario": name, "strategy": "random", "version": "base", "seed": 0},
            of.sample(60, rng),
        )
        for name, of in (("F1", space), ("X", still))
    ]
    searched = Searched(pd.concat(tests), {"F1": space, "X": still}, ())
    assert set(searched.of_group("children")["scenario"]) == {"F1"}


def test_a_base_of_a_uniform_set_has_no_planted_group(tmp_path: Path) -> None:
    comparison = read(
        FabricatedStudy(tmp_path).make_analysed().root / "comparison.json", Comparison
    )
    assert comparison.planted == () and planted_rows(comparison) == []


def test_a_rule_names_the_group_that_all_of_its_tests_belong_to() -> None:
    config = compose("default", [])
    space, rng = config.space("F1"), np.random.default_rng(0)
    points = space.sample(800, rng)
    tests = make_tests(
        space, {"scenario": "F1", "strategy": "random", "version": "base", "seed": 0}, points
    )
    failed = tests["animation"] == "crouching"
    tests = tests.assign(
        failure=failed,
        status="ok",
        failure_mode=np.where(failed, "contact", "none"),
        cause=np.where(failed, "box", "none"),
    )
    clustered = cluster(ScenarioInfo("F1", "F1", "", 100), space, tests, config.regions)
    assert clustered.regions and all(
        "animation = crouching" in region.groups for region in clustered.regions
    )
    assert not any("children" in region.groups for region in clustered.regions)
