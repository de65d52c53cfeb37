"""The step `cluster` executes failures again with single changes; the sentence and the bars say
what the rows say."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from pipeline.analysis.failure_regions import GroupedRegion, outcomes_of
from pipeline.artefacts.region_results import FailureRegion, FailureRegions, Repair
from pipeline.artefacts.results import read
from pipeline.artefacts.tables import UNCHANGED
from pipeline.config.composing import load
from pipeline.core.encounter import Encounter, RoadUsers
from pipeline.core.grouping import Group
from pipeline.core.loop import seed_of
from pipeline.core.rules import Rule
from pipeline.core.space import Value
from pipeline.errors import SimulationError
from pipeline.execution import explaining
from pipeline.execution.points import Executor
from pipeline.execution.workers import Setup
from pipeline.progress import Progress
from pipeline.report.kept_frames import KeptFrames
from pipeline.report.region_cards import Shown, cards, pictured
from pipeline.scenarios.changes import CONTROL, Change
from pipeline.simulators.analytic import AnalyticWorld
from tests.analysis.searched import world
from tests.campaigns import analytic_study
from tests.studies import StudyFolder

FAILURES = 6
CAUSES = {
    "fog": {"fog", "sun_altitude"},
    "stumbling": {"sun_altitude", "rain", "animation"},
    "rain": {"rain", "pedestrian_speed"},
}
"""What the planted regions of the analytic simulator are about, by what their rules begin with."""


class BreaksInClearWeather(AnalyticWorld):
    """Breaks without fog if the rain is above 50 %."""

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        if concrete["fog"] == 0 and float(concrete["rain"]) > 50:
            raise SimulationError("no fog, but rain")
        return super().reset(concrete, seed)


class ShowsItsNoise(AnalyticWorld):
    """Its ego stands aside by as many metres as the last three digits of its seed say."""

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        self._aside_m = float(seed % 1000)
        return super().reset(concrete, seed)

    def _users(self) -> RoadUsers:
        users = super()._users()
        return replace(users, ego=replace(users.ego, y=self._aside_m))


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> StudyFolder:
    breaking = f"simulator._target_={__name__}.{BreaksInClearWeather.__qualname__}"
    overrides = [
        "seeds=[0]",
        "campaign.tests=160",
        "samplers.mixed.batch_size=20",
        "strategies=[random,mixed]",
        f"regions.explain={FAILURES}",
    ]
    folder = analytic_study(tmp_path_factory.mktemp("explaining"), *overrides, breaking)
    for strategy in ("random", "mixed"):
        assert (
            folder.run(
                "campaign",
                kind="campaigns",
                scenario="F1",
                strategy=strategy,
                version="base",
                seed=0,
            )
            == 0
        )
    assert folder.run("cluster", scenario="F1", version="base") == 0
    assert not list(Path(folder / "journal").glob("cluster/**/*.npz")), "the journal is removed"
    return folder


@pytest.fixture(scope="module")
def base_regions(study: StudyFolder) -> FailureRegions:
    return read(study / "regions/base/F1.json", FailureRegions)


@pytest.fixture(scope="module")
def rows(study: StudyFolder) -> pd.DataFrame:
    return pd.read_parquet(study / "regions/base/F1.parquet")


def test_the_planted_cause_is_the_first_repair(base_regions: FailureRegions) -> None:
    assert len(base_regions.regions) >= 2
    for region in base_regions.regions:
        assert region.why is not None and region.why.control is not None
        (about,) = [names for begin, names in CAUSES.items() if region.rule.startswith(begin)]
        first = region.why.repairs[0]
        assert set(first.values) <= about, f"{region.rule}: {first.change}"
        assert first.repaired >= 0.8 * first.tests > 0
        control = region.why.control
        assert control.repaired == control.errors == 0 < control.tests


def test_every_number_comes_from_the_rows(base_regions: FailureRegions, rows: pd.DataFrame) -> None:
    for region in base_regions.regions:
        assert region.why is not None and region.why.control is not None
        in_region = rows[rows["region"] == region.name]
        before = in_region[in_region["change"] == UNCHANGED]
        assert tuple(before["test_id"]) == region.members and before["failure"].all()
        for repair in (*region.why.repairs, region.why.control):
            changed = in_region[in_region["change"] == repair.change]
            valid = changed[changed["status"] == "ok"]
            assert (
                repair.tests + repair.errors == len(changed) == min(FAILURES, len(region.members))
            )
            assert (repair.tests, repair.repaired) == (len(valid), int((~valid["failure"]).sum()))
            assert set(changed["test_id"]) <= set(region.members)
            if repair.rate is not None:
                assert (
                    repair.rate.low
                    <= repair.rate.value
                    == repair.repaired / repair.tests
                    <= repair.rate.high
                )
        # The oracle detects what a person sees, in the same frame.
        assert (before["first_detection_s"] == before["first_sight_s"]).all()
        assert (
            "as soon as they come into sight" in region.why.sentence
            and f"Medians of {len(before)} failures" in region.why.sentence
        )
        named = re.findall(
            r"(?:: |, )([^,;:(]+?(?: \([^)]*\))?) (\d+) of (\d+)",
            region.why.sentence.partition("Repairs")[2],
        )
        assert named
        for change, repaired, tests in named:
            (repair,) = [r for r in (*region.why.repairs, region.why.control) if r.change == change]
            assert (repair.repaired, repair.tests) == (int(repaired), int(tests))
    assert any(repair.errors for region in base_regions.regions for repair in _repairs(region)), (
        "executions that broke are counted apart"
    )


def test_no_failure_is_chosen_twice() -> None:
    tested, executor = world(8, 0), Mock()
    region = tested.regions.regions[0].model_copy(
        update={"members": tuple(tested.tests["test_id"])}
    )
    group = GroupedRegion(region, Group("box", np.ones(8, bool), Rule(())))
    outcomes = outcomes_of(tested.space, tested.tests)
    chosen = explaining.Counterfactuals(executor, 0.1, FAILURES).chosen(
        group, tested.tests.set_index("test_id"), outcomes
    )
    assert len({failure.test_id for failure in chosen}) == len(chosen) == FAILURES


def test_the_report_shows_the_text_and_a_bar_for_each_change(base_regions: FailureRegions) -> None:
    shown = cards(base_regions, pictured(base_regions, KeptFrames([])), Shown({}, {}, {}, 0.5))
    assert [card.name for card in shown[: len(base_regions.regions)]] == [
        region.name for region in base_regions.regions
    ]
    for card, region in zip(shown, base_regions.regions, strict=False):
        assert region.why is not None and card.text == region.why.sentence
        assert [(bar.label, bar.value) for bar in card.bars] == [
            (repair.change, repair.repaired) for repair in _repairs(region)
        ]
        assert all(bar.text.startswith(f"{bar.value} / ") for bar in card.bars)


def _repairs(region: FailureRegion) -> list[Repair]:
    assert region.why is not None and region.why.control is not None
    return [*region.why.repairs, region.why.control]


def test_a_killed_call_resumes(study: StudyFolder, tmp_path: Path) -> None:
    config = load(study.root / "params.yaml")
    setup = Setup(
        config.simulator,
        config.scenarios["F1"],
        config.detector,
        study / "models/base/model.onnx",
        config.car,
        config.limits,
    )
    points = [
        config.space("F1").decode(point)
        for point in config.space("F1").representatives(_first_cells(config.space("F1").sizes))
    ]
    with Progress("test") as progress:
        once = Executor(setup, tmp_path / "journal", 1, progress).outcomes(points, points)
        first, *others = sorted((tmp_path / "journal").glob("*.npz"))
        first.unlink()
        kept = {path: path.stat().st_mtime_ns for path in others}
        again = Executor(setup, tmp_path / "journal", 1, progress).outcomes(points, points)
        assert {path: path.stat().st_mtime_ns for path in others} == kept and first.exists()
        for resumed, uninterrupted in zip(again, once, strict=True):
            np.testing.assert_equal(dict(resumed.signals), dict(uninterrupted.signals))
        Executor(setup, tmp_path / "journal", 1, progress).outcomes(points, points[::-1])
        assert others[0].stat().st_mtime_ns != kept[others[0]], "other noise, other outcomes"


def test_a_changed_test_has_the_noise_of_the_failure_and_the_control_another(
    study: StudyFolder, tmp_path: Path
) -> None:
    config = load(study.root / "params.yaml")
    simulator = {"_target_": f"{__name__}.{ShowsItsNoise.__qualname__}"}
    setup = Setup(
        simulator,
        config.scenarios["F1"],
        config.detector,
        study / "models/base/model.onnx",
        config.car,
        config.limits,
    )
    (point,) = (
        config.space("F1").decode(row)
        for row in config.space("F1").sample(1, np.random.default_rng(0))
    )
    clear = {**point, "fog": 0.0}
    failure, change = explaining.Failure("region", "test", point), Change("no fog", {"fog": 0.0})
    noises = [explaining._Changed(failure, *of).noise for of in ((change, clear), (CONTROL, point))]
    with Progress("test") as progress:
        outcomes = Executor(setup, tmp_path / "journal", 1, progress).outcomes(
            [clear, point], noises
        )
    first, other = (outcome.signals["ego_y_m"][0] for outcome in outcomes)
    assert first == seed_of(point) % 1000 != other


def _first_cells(sizes: tuple[int, ...]) -> NDArray[np.int64]:
    return np.array([[0] * len(sizes), [1] * len(sizes), [2 % size for size in sizes]])


def test_without_executions_the_text_says_what_the_camera_saw(
    study: StudyFolder, base_regions: FailureRegions
) -> None:
    config = load(study.root / "params.yaml")
    plain = config.model_copy(update={"regions": config.regions.model_copy(update={"explain": 0})})
    other = StudyFolder.of(study.root, plain)
    assert other.run("cluster", scenario="F1", version="base") == 0
    for region, before in zip(
        read(study / "regions/base/F1.json", FailureRegions).regions,
        base_regions.regions,
        strict=True,
    ):
        assert region.why is not None and before.why is not None
        assert (
            region.why.repairs == ()
            and region.why.control is None
            and region.why.seen == before.why.seen
        )
        assert before.why.sentence.startswith(region.why.sentence)
