"""Failure regions with readable rules."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.analysis.failure_regions import _representatives, cluster
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import read
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.config.sections import Regions
from pipeline.core import kpi
from pipeline.core.loop import run_test
from pipeline.core.space import Space, Variable
from pipeline.detectors.scripted import BlindDetector
from pipeline.simulators.analytic import AnalyticWorld
from pipeline.testing import CAR
from tests.analysis.fabricated import FabricatedStudy, make_tests
from tests.spaces import SMALL, THESIS

SPACE = Space(
    (
        Variable("fog", "continuous", "%", 0, 100, 10),
        Variable("sun_altitude", "continuous", "deg", -20, 90, 10),
    )
)
KEYS = {"scenario": "F", "strategy": "random", "version": "base", "seed": 0}
INFO = ScenarioInfo("F", "F", "", 1)


def test_planted_region_is_found_with_its_rule() -> None:
    tests = make_tests(SPACE, KEYS, SPACE.sample(400, np.random.default_rng(0)), fog_from=60)
    tests = tests[tests["status"] == "ok"].reset_index(drop=True)
    tests["cause"] = np.where(tests["failure"], "box", "none")
    result = cluster(
        INFO, SPACE, tests, Regions(chance_neighbours=1, min_failures=4, confirm=0, explain=0)
    )
    assert len(result.regions) == 1
    region = result.regions[0]
    assert region.rule == "fog >= 60 % and sun_altitude <= 3 deg" and region.cause == "box"
    assert [(c.variable, c.low, c.high) for c in region.conditions] == [
        ("fog", 60, 100),
        ("sun_altitude", -20, 3),
    ]
    assert (
        region.status == "not confirmed"
        and 0.9 < region.held_back.failures / region.failures_inside <= 1
    )
    assert region.lift == pytest.approx(region.precision / result.failure_rate)
    assert region.failures_inside == len(region.members) == result.failures == region.modes.total
    assert region.precision == region.failures_inside / region.support
    assert region.recall == 1
    assert result.isolated == ()
    medoid = region.representatives[0]
    assert medoid.role == "medoid"
    assert medoid.test_id in region.members
    assert abs(float(medoid.concrete["fog"]) - 80) < 12
    assert len({r.test_id for r in region.representatives}) == len(region.representatives)


def test_two_corners_are_two_regions() -> None:
    points = np.array(
        [[f, a] for f in (90, 92, 95, 98) for a in (-18, -15)]
        + [[f, a] for f in (2, 4, 6, 8) for a in (80, 85)]
    )
    passing = SPACE.sample(100, np.random.default_rng(1)) * [0.3, 0.4] + [30, 15]
    tests = make_tests(SPACE, KEYS, np.concatenate([points, passing]), fog_from=1000)
    tests["failure"] = np.arange(len(tests)) < 16
    tests["failure_mode"] = np.where(tests["failure"], "late", "none")
    tests["status"] = "ok"
    result = cluster(
        INFO, SPACE, tests, Regions(chance_neighbours=0.5, min_failures=3, confirm=0, explain=0)
    )
    assert [len(region.members) for region in result.regions] == [8, 8]
    assert {region.support for region in result.regions} == {8}


def test_without_failures_there_is_no_region() -> None:
    tests = make_tests(SPACE, KEYS, SPACE.sample(20, np.random.default_rng(0)), fog_from=1000)
    result = cluster(
        INFO, SPACE, tests, Regions(chance_neighbours=0.5, min_failures=3, confirm=0, explain=0)
    )
    assert (result.failures, result.regions, result.isolated, result.connected) == (0, (), (), 0)


def everywhere(tests: pd.DataFrame) -> FailureRegions:
    return cluster(
        INFO, SPACE, tests, Regions(chance_neighbours=0.5, min_failures=4, confirm=0, explain=0)
    )


def test_every_test_fails_is_one_region_that_says_so() -> None:
    world, space = AnalyticWorld(), THESIS
    points = space.sample(60, np.random.default_rng(0))
    # At 10 s, every test with a detector that sees nothing is a failure.
    outcomes = [
        kpi.evaluate(run_test(world, BlindDetector(), CAR, space.decode(point)).signals, 10.0)
        for point in points
    ]
    tests = make_tests(space, KEYS, points).assign(
        status="ok", failure=[outcome.failure for outcome in outcomes], failure_mode="late"
    )
    result = cluster(
        INFO, space, tests, Regions(chance_neighbours=0.5, min_failures=4, confirm=0, explain=0)
    )
    (region,) = result.regions
    assert (
        region.rule,
        region.support,
        region.failures_inside,
        region.precision,
        region.recall,
    ) == ("every test", 60, 60, 1, 1)
    assert set(region.members) == set(tests["test_id"]) and result.isolated == ()


def test_a_few_passing_tests_tell_no_regions_apart() -> None:
    tests = make_tests(SPACE, KEYS, SPACE.sample(60, np.random.default_rng(0))).assign(
        status="ok", failure_mode="late"
    )
    nearly = everywhere(tests.assign(failure=np.arange(60) % 30 > 0))
    assert [(region.rule, region.failures_inside, region.support) for region in nearly.regions] == [
        ("every test", 58, 60)
    ]
    # Three failing tests are too few for a region.
    few = everywhere(tests[:3].assign(failure=True))
    assert few.regions == () and len(few.isolated) == 3


def test_a_test_of_two_campaigns_counts_once(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path / "study").make()
    campaign, same = study.search_tests[0], tmp_path / "same" / "tests.parquet"
    shutil.copytree(campaign.parent, same.parent)
    written = []
    for tests in ([campaign], [campaign, same]):
        signals = [str(path.with_name("signals.parquet")) for path in tests]
        study.run(
            "cluster",
            {"tests": list(map(str, tests)), "signals": signals},
            version="base",
            scenario="F1",
        )
        written.append(study.regions[0].read_bytes())
    assert written[0] == written[1]


def test_step_on_files(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make_analysed()
    for path in study.regions:
        result = read(path, FailureRegions)
        members = [test for region in result.regions for test in region.members]
        assert sorted([*members, *result.isolated]) == sorted(set(members) | set(result.isolated))
        assert len(members) + len(result.isolated) == result.failures > 0
        assert result.regions
        assert "fog" in result.regions[0].rule


def test_the_worst_failure_is_the_hardest_contact() -> None:
    points = np.array([[x, 0, 1, 0] for x in (1.0, 2, 3, 9)])
    rows = pd.DataFrame([SMALL.decode(point) for point in points]).assign(
        test_id=list("abcd"), strategy="s", seed=0
    )
    rows = rows.assign(impact_speed_mps=[0.0, 2, 8, np.nan], adj_ttc_s=[0.01, 0.05, 0.05, 0.05])
    roles = {test.role: test.test_id for test in _representatives(SMALL, rows, points)}
    assert roles == {"medoid": "b", "worst": "c", "furthest": "d"}
