"""The step `cluster` confirms rules by fresh tests, which count in no campaign."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from pipeline.analysis.failure_regions import GroupedRegion
from pipeline.artefacts.region_results import FailureRegion, FailureRegions
from pipeline.artefacts.results import read
from pipeline.artefacts.tables import read_tests
from pipeline.config.composing import compose, functional_scenario
from pipeline.core.encounter import Encounter
from pipeline.core.grouping import Group
from pipeline.core.rules import Condition, Rule
from pipeline.core.space import Value
from pipeline.errors import SimulationError
from pipeline.execution import confirming
from pipeline.execution.confirming import FreshTests
from pipeline.execution.points import Executor
from pipeline.execution.workers import Setup
from pipeline.progress import Progress
from pipeline.report.kept_frames import KeptFrames
from pipeline.report.region_cards import Shown, cards, pictured
from pipeline.simulators.analytic import AnalyticWorld
from tests.analysis.searched import world
from tests.campaigns import analytic_study
from tests.spaces import SMALL

FRESH = 12


class BreaksInDenseFog(AnalyticWorld):
    """Breaks in fog above 90 %."""

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        if float(concrete["fog"]) > 90:
            raise SimulationError("dense fog")
        return super().reset(concrete, seed)


@pytest.fixture(scope="module")
def base_regions(tmp_path_factory: pytest.TempPathFactory) -> FailureRegions:
    breaking = f"simulator._target_={BreaksInDenseFog.__module__}.{BreaksInDenseFog.__qualname__}"
    overrides = [
        "seeds=[0]",
        "campaign.tests=160",
        "samplers.mixed.batch_size=20",
        f"regions.confirm={FRESH}",
        breaking,
    ]
    study = analytic_study(tmp_path_factory.mktemp("confirming"), *overrides)
    for strategy in ("random", "mixed"):
        assert (
            study.run(
                "campaign",
                kind="campaigns",
                scenario="F1",
                strategy=strategy,
                version="base",
                seed=0,
            )
            == 0
        )
    assert study.run("cluster", scenario="F1", version="base") == 0
    assert not list(Path(study / "journal").glob("cluster/**/*.npz")), "the journal is removed"
    executed = sum(
        len(read_tests(study / f"campaigns/F1/{strategy}/base/0/tests.parquet"))
        for strategy in ("random", "mixed")
    )
    result = read(study / "regions/base/F1.json", FailureRegions)
    assert result.tests < executed == 320, "errors are left out, and fresh tests are not added"
    return result


def test_every_rule_has_its_fresh_tests_and_errors_apart(base_regions: FailureRegions) -> None:
    assert base_regions.regions
    for region in base_regions.regions:
        confirmation = region.confirmation
        assert confirmation is not None
        for fresh in (confirmation.inside, confirmation.outside):
            assert fresh.tests + fresh.errors == FRESH and fresh.failures <= fresh.tests
            if fresh.rate is not None:
                assert (
                    fresh.rate.low
                    <= fresh.rate.value
                    == fresh.failures / fresh.tests
                    <= fresh.rate.high
                )
    (fog,) = [
        region
        for region in base_regions.regions
        if "fog >= " in region.rule and "sun_altitude <= " in region.rule
    ]
    assert (
        fog.status == "confirmed"
        and fog.confirmation is not None
        and fog.confirmation.inside.errors > 0
    )


def confirm(
    condition: Condition, base_regions: FailureRegions, folder: Path
) -> tuple[FailureRegion, ...]:
    config = compose("smoke", ["simulator=analytic", "detector=oracle"])
    setup = Setup(
        config.simulator, config.scenarios["F1"], config.detector, folder, config.car, config.limits
    )
    fresh = FreshTests(
        config.space("F1"),
        Executor(setup, folder / "journal", 1, Progress("cluster")),
        0.1,
        FRESH,
        0.95,
    )
    return fresh.confirm(
        [
            GroupedRegion(
                base_regions.regions[0], Group("mixed", np.zeros(0, bool), Rule((condition,)))
            )
        ]
    )


def test_a_rule_that_hardly_any_point_meets_is_not_confirmed(
    base_regions: FailureRegions, tmp_path: Path
) -> None:
    (region,) = confirm(
        Condition(functional_scenario("F1").logical_space().names.index("fog"), 99.99999, 100),
        base_regions,
        tmp_path,
    )
    assert region.status == "not confirmed"
    assert (
        region.confirmation is not None
        and region.confirmation.inside.tests == region.confirmation.outside.tests == 0
    )


def test_an_error_other_than_a_narrow_rule_is_not_hidden(
    base_regions: FailureRegions, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise ValueError("operands could not be broadcast together")

    monkeypatch.setattr(confirming, "draw_inside", refuse)
    with pytest.raises(ValueError, match="broadcast"):
        confirm(Condition(0, 0, 100), base_regions, tmp_path)


@pytest.mark.parametrize(("confidence", "status"), [(0.95, "not confirmed"), (0.7, "confirmed")])
def test_a_rule_is_confirmed_at_the_confidence_of_the_study(confidence: float, status: str) -> None:
    """Failures in 3 of 4 tests inside and 1 of 4 outside have a chance of 17 / 70 = 0.24 by
    Fisher's test."""
    failures = [True, True, True, False, True, False, False, False]
    executor: Any = Mock()
    executor.outcomes.return_value = [
        Mock(is_error=False, kpi=Mock(return_value=Mock(failure=failure))) for failure in failures
    ]
    group = GroupedRegion(
        world(9, 9).regions.regions[0], Group("box", np.zeros(0, bool), Rule((Condition(0, 2, 4),)))
    )
    (region,) = FreshTests(SMALL, executor, 0.1, 4, confidence).confirm([group])
    assert region.status == status


def test_the_report_says_what_confirms_a_rule(base_regions: FailureRegions) -> None:
    shown = {
        card.name: card
        for card in cards(
            base_regions, pictured(base_regions, KeptFrames([])), Shown({}, {}, {}, 0.5)
        )
    }
    for region in base_regions.regions:
        assert region.confirmation is not None
        inside, card = region.confirmation.inside, shown[region.name]
        assert card.tag == region.status
        assert dict(card.facts)["fresh tests inside"].startswith(
            f"{inside.failures} / {inside.tests}"
        )
    assert any("; errors: " in value for card in shown.values() for _, value in card.facts)
