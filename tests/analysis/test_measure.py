"""Measures of campaigns, by hand-computed cases."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.analysis.measures import measure_campaign, summarise, theta_table
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.results import CampaignMeasures, Measures, read
from pipeline.core.identity import CampaignId
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError
from tests.analysis.fabricated import FabricatedStudy, make_tests

SPACE = Space((Variable("fog", "continuous", "%", 0, 100, 50), Variable("gait", "categorical", values=("walk", "run"))))


def rows(strategy: str, failures: Sequence[int], errors: Sequence[int] = ()) -> pd.DataFrame:
    """Five tests at fog 0 walking; the given ones fail (counted from 1) or are errors."""
    order = range(1, 6)
    failed = [i in failures for i in order]
    return pd.DataFrame(
        {
            "test_id": [f"F-{strategy}-base-0-{i:05d}" for i in order],
            "index": order,
            "status": ["error" if i in errors else "ok" for i in order],
            "failure": failed,
            "failure_mode": ["contact" if f else "none" for f in failed],
            "fog": 0.0,
            "gait": "walk",
        }
    )


def measured(own: Sequence[int], baseline: Sequence[int], errors: Sequence[int] = ()) -> CampaignMeasures:
    tables = {
        CampaignId("F", "random", "base", 0): rows("random", baseline),
        CampaignId("F", "neural", "base", 0): rows("neural", own, errors),
    }
    return measure_campaign(CampaignId("F", "neural", "base", 0), tables, {"F": SPACE}, "random")


def test_f_and_c_measure_by_hand() -> None:
    result = measured(own=[1, 2, 5], baseline=[3, 4])
    assert result.theta == (1, 2, 2, 2, 3)
    assert (result.f_measure, result.n, result.f_n) == (1, 2, 2)
    assert result.c_measure == pytest.approx(1 - 2 / 4)
    assert not result.c_measure_assumed


def test_baseline_without_failure_counts_its_next_test() -> None:
    result = measured(own=[2], baseline=[])
    assert result.c_measure == pytest.approx(1 - 2 / 6)
    assert result.c_measure_assumed


def test_c_is_undefined_with_too_few_failures() -> None:
    result = measured(own=[1], baseline=[1, 2])
    assert (result.c_measure, result.f_n, result.f_measure) == (None, None, 1)


def test_errors_use_budget_but_cover_nothing() -> None:
    result = measured(own=[5], baseline=[5], errors=[1, 2, 3, 4])
    assert (result.tests, result.errors, result.f_measure) == (5, 4, 5)
    # One of the 3 x 2 pairs of categories; each wants three tests.
    assert result.pair_coverage_tests == pytest.approx(1 / 6)
    assert result.projection_coverage == pytest.approx(1 / 18)


def test_the_baseline_has_no_c_measure() -> None:
    tables = {CampaignId("F", "random", "base", 0): rows("random", [1])}
    assert measure_campaign(CampaignId("F", "random", "base", 0), tables, {"F": SPACE}, "random").c_measure is None


def test_missing_baseline_and_space_are_named() -> None:
    tables = {CampaignId("F", "neural", "base", 3): rows("neural", [1])}
    with pytest.raises(InputError, match="^campaign F-neural-base-3: expected a 'random' campaign of seed 3 beside it, got none$"):
        measure_campaign(CampaignId("F", "neural", "base", 3), tables, {"F": SPACE}, "random")
    with pytest.raises(InputError, match=r"^campaign F-neural-base-3: expected the space of scenario 'F', got \[\]$"):
        measure_campaign(CampaignId("F", "neural", "base", 3), tables, {}, "random")


def test_summary_over_seeds() -> None:
    first, second = measured([1, 2], [4]), measured([5], [])
    summary = summarise([first, second.model_copy(update={"seed": 1})], 0.95)
    assert (summary.failures, summary.tests, summary.seeds) == (3, 10, (0, 1))
    assert summary.rate.value == pytest.approx(0.3)
    assert summary.rate.low < 0.3 < summary.rate.high
    assert summary.f_measure is not None
    # Tests until the first failure, 1 and 5: Student's interval of two seeds is 3 ± 25.4, and no F is below 1.
    assert (summary.f_measure.value, summary.f_measure.low) == (3, 1)
    assert summary.f_measure.high == pytest.approx(28.412, abs=1e-3)
    assert summary.failures_per_campaign.value == pytest.approx(1.5)


def test_theta_table_holds_means_over_seeds() -> None:
    table = theta_table([measured([1, 2], [4]), measured([5], [])])
    assert list(table.columns) == ["tests", "F-neural"]
    assert table["F-neural"].tolist() == [0.5, 1, 1, 1, 1.5]
    assert table["tests"].tolist() == [1, 2, 3, 4, 5]


def test_step_writes_the_same_measures_twice(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make()
    contents = []
    for _ in range(2):
        study.run("measure")
        contents.append([(study.root / name).read_bytes() for name in ("measures.json", "theta.csv")])
    assert contents[0] == contents[1]
    result = read(study.root / "measures.json", Measures)
    assert len(result.campaigns) == 8
    for campaign in result.campaigns:
        assert campaign.theta[-1] == campaign.failures == campaign.modes.total
    assert sum(campaign.errors for campaign in result.campaigns) > 0


def test_wrong_results_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "measures.json"
    path.write_text('{"confidence": 0.95')
    with pytest.raises(InputError, match="measures.json"):
        read(path, Measures)
    path.write_text('{"confidence": 0.95, "k": 2, "baseline": "random", "campaigns": [], "strategies": [], "more": 1}')
    with pytest.raises(InputError, match="more"):
        read(path, Measures)


def test_value_outside_the_space_names_the_test() -> None:
    tests = make_tests(SPACE_OF_STUDY, {"scenario": "F", "strategy": "s", "version": "base", "seed": 0}, SPACE_OF_STUDY.sample(3, RNG))
    tests.loc[1, "fog"] = 300.0
    with pytest.raises(InputError, match=r"test F-s-base-0-00001: fog must be in \[0, 100\] %, got"):
        encode_tests(tests, SPACE_OF_STUDY)


RNG = np.random.default_rng(0)
SPACE_OF_STUDY = Space((Variable("fog", "continuous", "%", 0, 100, 10), Variable("sun_altitude", "continuous", "deg", -20, 90, 10)))
