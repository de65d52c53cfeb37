"""The evidence for a safety case: its areas in worlds of known truth, its numbers on artefacts."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.analysis.evidence import (
    NO_RANDOM,
    ONLY_RANDOM,
    UNCONFIRMED,
    Judged,
    Searched,
    judged,
    mean_of,
    scenario_evidence,
    share_of,
    whole,
)
from pipeline.analysis.stored_rules import stored_rule
from pipeline.artefacts.evidence import Evidence
from pipeline.artefacts.files import read_json, sha256
from pipeline.artefacts.region_results import (
    FailureRegions,
    RuleCondition,
)
from pipeline.artefacts.results import read
from pipeline.artefacts.tables import read_tests
from pipeline.config.composing import compose
from pipeline.config.exposure import ExposureFile, read_exposure
from pipeline.config.sections import Regions
from pipeline.core.shown import shown_share
from pipeline.core.space import Space
from tests.analysis.fabricated import OVERRIDES, FabricatedStudy
from tests.analysis.searched import HIDDEN, SPACE, world

SECTION = Regions(chance_neighbours=0.5, min_failures=4, confirm=0, explain=0)


def look(tested: Searched, exposure: str = "uniform") -> Judged:
    return judged(tested, SECTION, read_exposure(exposure))


def test_a_share_that_every_draw_has_is_no_certainty() -> None:
    """As 1,000 tests without a failure: at most 3 / 1,000, by the rule of three."""
    nothing = mean_of(np.zeros(1000))
    assert nothing == share_of(np.zeros(1000, bool)) and nothing.limits.below == pytest.approx(
        0.003, abs=1e-4
    )
    half = mean_of(np.tile([0.0, 1.0], 500))
    assert (half.limits.low, half.limits.below, half.limits.high) == pytest.approx(
        (0.469, 0.526, 0.531), abs=1e-3
    )


def test_the_areas_of_a_known_world() -> None:
    evidence = scenario_evidence(look(world(random=600, searched=300)))
    areas, risk = evidence.areas, evidence.areas.unknown_unsafe
    assert (
        areas.known_unsafe.share is not None
        and areas.known_unsafe.share.low <= 0.2 <= areas.known_unsafe.share.high
    )
    assert risk.share is not None and risk.share.low <= HIDDEN <= risk.share.high
    assert (
        evidence.failure.share is not None
        and evidence.failure.share.low <= 0.2 + HIDDEN <= evidence.failure.share.high
    )
    # The last category, x >= 9, has passed tests below 9.4, so every combination outside the rule
    # is shown.
    assert areas.known_safe.share is not None and areas.known_safe.share.value == pytest.approx(
        0.8, abs=0.01
    )
    total = sum(
        area.share.value
        for area in (areas.known_unsafe, areas.known_safe, areas.unknown)
        if area.share
    )
    assert total == pytest.approx(1)


def test_the_interval_of_the_unknown_unsafe_area_holds() -> None:
    """Exact intervals hold at least as often as their confidence.

    At 95 %, fewer than 50 of 60 intervals hold once in 10,000 times.
    """
    inside = 0
    for seed in range(60):
        hidden = look(world(random=80, searched=80, seed=seed)).hidden
        assert hidden is not None
        inside += hidden.limits.low <= HIDDEN <= hidden.limits.high
    assert inside >= 50


def test_conditions_that_no_passed_test_shows_are_unknown() -> None:
    """The search ends at x = 8; the next category begins at x = 9."""
    areas = scenario_evidence(look(world(random=0, searched=3000))).areas
    assert areas.unknown.share is not None and areas.unknown.share.value == pytest.approx(
        0.1, abs=0.005
    )


def test_tests_of_a_search_enter_no_rate() -> None:
    tested = world(random=100, searched=100)
    before = look(tested).failure
    changed = tested.tests.assign(
        failure=np.where(tested.tests["strategy"] == "mixed", True, tested.tests["failure"])
    )
    assert look(replace(tested, tests=changed)).failure == before


def test_each_constraint_stays_as_it_was_written() -> None:
    tested = world(random=60, searched=20)
    clauses = ("if x <= 2 then y >= 6", ("x = 0", "y != 2"))
    outside = (tested.tests["x"] > 3) & (tested.tests["y"] > 5)
    evidence = scenario_evidence(
        look(replace(tested, space=Space(SPACE.variables, clauses), tests=tested.tests[outside]))
    )
    assert evidence.domain.constraints == ((clauses[0],), clauses[1])


def test_where_no_estimate_is_possible_the_file_says_why() -> None:
    searched = scenario_evidence(look(world(random=0, searched=100)))
    assert (searched.failure.share, searched.failure.missing) == (None, NO_RANDOM)
    assert (searched.areas.unknown_unsafe.share, searched.areas.unknown_unsafe.missing) == (
        None,
        NO_RANDOM,
    )
    random = scenario_evidence(look(world(random=100, searched=0)))
    assert random.failure.share and (
        random.areas.unknown_unsafe.share,
        random.areas.unknown_unsafe.missing,
    ) == (None, ONLY_RANDOM)
    assert (random.areas.confirmed.share, random.areas.confirmed.missing) == (None, UNCONFIRMED)


def test_errors_are_in_no_share() -> None:
    tested = world(random=100, searched=100)
    broken = tested.tests["test_id"].isin(
        ["random-0", "random-1", "mixed-0"]
    )  # The last is of a search.
    failure = scenario_evidence(
        look(replace(tested, tests=tested.tests.assign(status=np.where(broken, "error", "ok"))))
    ).failure
    assert (failure.tests, failure.errors) == (98, 2)


def test_another_exposure_weighs_the_same_tests() -> None:
    """Here x is below 5 in nine of ten encounters; 0.4 of them fail, 2 * HIDDEN of the others."""
    plain = {
        "kind": "histogram",
        "edges": [0, 5, 10],
        "shares": [0.9, 0.1],
        "source": "made for this test",
    }
    exposure = ExposureFile(description="d", variables={"x": plain})
    evidence = scenario_evidence(judged(world(random=2000, searched=300), SECTION, exposure))
    truth = {"failure": 0.9 * 0.4 + 0.1 * 2 * HIDDEN, "hidden": 0.1 * 2 * HIDDEN}
    assert (
        evidence.failure.share
        and evidence.failure.share.low <= truth["failure"] <= evidence.failure.share.high
    )
    risk, unsafe = evidence.areas.unknown_unsafe.share, evidence.areas.known_unsafe.share
    assert risk and risk.low <= truth["hidden"] <= risk.high
    assert unsafe and unsafe.low <= 0.36 <= unsafe.high


def test_all_scenarios_need_shares() -> None:
    single, exposure = look(world(random=50, searched=50)), read_exposure("uniform")
    assert whole([single], exposure) is not None and whole([single, single], exposure) is None


def test_shown_share_equals_brute_force() -> None:
    rng = np.random.default_rng(3)
    sizes = (2, 3, 2, 4)
    seen, asked = (rng.integers(sizes, size=(count, len(sizes))) for count in (5, 40))
    for k in (1, 2, 3):
        shares = []
        for subset in map(list, combinations(range(4), k)):
            cells = {tuple(point[subset]) for point in seen}
            shares.append([tuple(point[subset]) in cells for point in asked])
        truth = np.mean(shares, axis=0)
        assert shown_share(sizes, seen, asked, k) == pytest.approx(truth)
    assert shown_share(sizes, seen[:0], asked, 2).max() == 0


def test_a_stored_rule_admits_the_same_points() -> None:
    config = compose("default", OVERRIDES)
    space = config.space("F1")
    stored = (
        RuleCondition(variable="sun_azimuth", text="", low=330, high=30),
        RuleCondition(variable="rain - fog", text="", low=-12, high=12),
        RuleCondition(variable="animation", text="", values=("crouching", "walking")),
    )
    points = space.sample(500, np.random.default_rng(0))
    azimuth, rain, fog, pose = (
        points[:, space.names.index(name)] for name in ("sun_azimuth", "rain", "fog", "animation")
    )
    values = space.variables[space.names.index("animation")].values
    truth = ((azimuth >= 330) | (azimuth <= 30)) & (np.abs(rain - fog) <= 12)
    truth &= np.isin(pose, [values.index("crouching"), values.index("walking")])
    assert (stored_rule(space, stored).holds(points) == truth).all()


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> FabricatedStudy:
    fabricated = FabricatedStudy(
        tmp_path_factory.mktemp("study"), compose("default", [*OVERRIDES, "search=[F1]"])
    ).make()
    fabricated.run("cluster", version="base", scenario="F1")
    fabricated.run("evidence", version="base")
    return fabricated


def test_every_number_equals_its_artefact(study: FabricatedStudy) -> None:
    evidence = read(study.root / "evidence" / "base.json", Evidence)
    (scenario,) = evidence.scenarios
    tables = {path: read_tests(path) for path in study.search_tests}
    valid = pd.concat(tables.values()).query("status == 'ok'")
    random = valid[valid["strategy"] == "random"]
    assert (scenario.failure.tests, scenario.failure.failures) == (
        len(random),
        int(random["failure"].sum()),
    )
    assert scenario.coverage.tests == len(valid)
    regions = read(study.regions[0], FailureRegions)
    assert [(r.name, r.rule, r.status, r.failures) for r in scenario.open_regions] == [
        (r.name, r.rule, r.status, len(r.members)) for r in regions.regions
    ]
    assert scenario.isolated_failures == len(regions.isolated)
    assert evidence.model.sha256 == sha256(study.folder / study.files.detector("base"))
    assert (
        evidence.files == {name: sha256(study.folder / name) for name in evidence.files}
        and len(evidence.files) == len(tables) + 4
    )
    # Fails at night in fog: 55 % of the fog's range, and 22 of 110 degrees of the sun's.
    space = study.config.space("F1").to_dict()
    assert scenario.domain.variables == json.loads(json.dumps(space))
    share = scenario.areas.known_unsafe.share
    assert share is not None and share.value == pytest.approx(0.11, abs=0.02)


def test_the_page_shows_the_same_numbers(study: FabricatedStudy) -> None:
    evidence = read(study.root / "evidence" / "base.json", Evidence)
    page = (study.root / "evidence" / "base.html").read_text()
    (scenario,) = evidence.scenarios
    assert evidence.model.sha256 in page and evidence.settings_sha256 in page
    assert f"{scenario.failure.failures} of {scenario.failure.tests} random tests fail" in page
    assert f"{scenario.coverage.covered:,} of {scenario.coverage.required:,}" in page
    assert all(name in page for name in scenario.domain.variables)


def test_the_file_meets_the_published_schema(study: FabricatedStudy) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    schema = Path(__file__).parents[2] / "docs" / "reference" / "evidence.schema.json"
    jsonschema.validate(
        read_json(study.root / "evidence" / "base.json"), json.loads(schema.read_text())
    )
