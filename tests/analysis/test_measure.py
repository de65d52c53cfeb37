"""Measures of campaigns, by hand-computed cases."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import pytest

from pipeline.analysis.measures import measure_campaign, summarise, theta_table
from pipeline.artefacts.failure_counts import Causes, FalseActivations
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.results import read
from pipeline.artefacts.search_results import CampaignMeasures, Measures, StrategyMeasures
from pipeline.core.causes import Cause
from pipeline.core.identity import CampaignId
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError
from pipeline.report.failure_tables import CAUSES, braking_cells
from pipeline.report.formats import censored
from tests.analysis.fabricated import FabricatedStudy, make_tests

SPACE = Space(
    (
        Variable("fog", "continuous", "%", 0, 100, 50),
        Variable("gait", "categorical", values=("walk", "run")),
    )
)


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
            "cause": ["box" if f else "none" for f in failed],
            "false_activations": [i % 3 for i in order],
            "false_activation_s": [0.5 * (i % 3) for i in order],
            "speed_loss_mps": [2.0] * 5,
            "fog": 0.0,
            "gait": "walk",
        }
    )


def measured(
    failures: Sequence[int], baseline: Sequence[int], errors: Sequence[int] = ()
) -> CampaignMeasures:
    tables = {
        CampaignId("F", "random", "base", 0): rows("random", baseline),
        CampaignId("F", "forest", "base", 0): rows("forest", failures, errors),
    }
    return measure_campaign(CampaignId("F", "forest", "base", 0), tables, {"F": SPACE}, "random")


def test_f_and_c_measure_by_hand() -> None:
    result = measured(failures=[1, 2, 5], baseline=[3, 4])
    assert result.theta == (1, 2, 2, 2, 3)
    assert (result.f_measure, result.n, result.f_n) == (1, 2, 2)
    assert result.c_measure == pytest.approx(1 - 2 / 4)
    assert not result.c_measure_assumed


def test_baseline_without_failure_counts_its_next_test() -> None:
    result = measured(failures=[2], baseline=[])
    assert result.c_measure == pytest.approx(1 - 2 / 6)
    assert result.c_measure_assumed


def test_c_is_undefined_with_too_few_failures() -> None:
    result = measured(failures=[1], baseline=[1, 2])
    assert (result.c_measure, result.f_n, result.f_measure) == (None, None, 1)


def test_errors_use_budget_but_cover_nothing() -> None:
    result = measured(failures=[5], baseline=[5], errors=[1, 2, 3, 4])
    assert (result.tests, result.errors, result.f_measure) == (5, 4, 5)
    # One of the 3 x 2 pairs of categories; each wants three tests.
    assert result.pair_coverage_tests == pytest.approx(1 / 6)
    assert result.projection_coverage == pytest.approx(1 / 18)


def test_failures_by_cause_and_false_activations_by_hand() -> None:
    result = measured(failures=[1, 2, 5], baseline=[3])
    assert result.causes == Causes(box=3) and result.causes.total == 3
    # One, two, none, one and two false activations of half a second.
    activations = result.false_activations
    assert (
        activations.tests,
        activations.braking,
        activations.number,
        activations.mean_duration_s,
        activations.mean_speed_loss_mps,
    ) == (5, 4, 6, 0.5, 2)
    # The second test, with two of them, is an error.
    assert measured(failures=[], baseline=[3], errors=[2]).false_activations.number == 4
    summary = over_seeds(result, result)
    assert summary.causes.box == 6 and (
        summary.false_activations.tests,
        summary.false_activations.number,
    ) == (10, 12)
    none = FalseActivations(tests=3)
    assert none.mean_duration_s is none.mean_speed_loss_mps is None
    assert braking_cells(none) == ("3", "0", "0", "–", "–")
    assert braking_cells(activations) == ("5", "4", "6", "0.50 s", "2.0 m/s (7 km/h)")


def test_every_cause_of_a_failure_is_counted_and_named() -> None:
    assert {*Causes.model_fields, "none"} == set(get_args(Cause)) and [*Causes.model_fields] == [
        *CAUSES
    ]


def test_the_baseline_has_no_c_measure() -> None:
    tables = {CampaignId("F", "random", "base", 0): rows("random", [1])}
    assert (
        measure_campaign(
            CampaignId("F", "random", "base", 0), tables, {"F": SPACE}, "random"
        ).c_measure
        is None
    )


def test_missing_baseline_and_space_are_named() -> None:
    tables = {CampaignId("F", "forest", "base", 3): rows("forest", [1])}
    with pytest.raises(
        InputError,
        match="^campaign F-forest-base-3: expected a 'random' campaign of seed 3 beside it, got "
        "none$",
    ):
        measure_campaign(CampaignId("F", "forest", "base", 3), tables, {"F": SPACE}, "random")
    with pytest.raises(
        InputError,
        match=r"^campaign F-forest-base-3: expected the space of scenario 'F', got \[\]$",
    ):
        measure_campaign(CampaignId("F", "forest", "base", 3), tables, {}, "random")


def test_summary_over_seeds() -> None:
    first, second = measured([1, 2], [4]), measured([5], [])
    summary = over_seeds(first, second)
    assert (summary.failures, summary.tests, summary.seeds) == (3, 10, (0, 1))
    # The campaigns' rates, 0.4 and 0.2, in Student's interval: their tests depend on each other. No
    # rate is below 0.
    assert (summary.rate.value, summary.rate.low, summary.rate.high) == pytest.approx((0.3, 0, 1))
    assert summary.f_measure_censored == 0
    # Tests until the first failure, 1 and 5: Student's interval of two seeds is 3 ± 25.4, and no F
    # is below 1.
    assert (summary.f_measure.value, summary.f_measure.low) == (3, 1)
    assert summary.f_measure.high == pytest.approx(28.412, abs=1e-3)


def over_seeds(*campaigns: CampaignMeasures) -> StrategyMeasures:
    return summarise(
        [c.model_copy(update={"seed": seed}) for seed, c in enumerate(campaigns)],
        0.95,
        "random",
        {"random"},
    )


def test_the_rate_of_independent_tests_has_the_exact_interval() -> None:
    summary = over_seeds(
        *(
            measured([1, 2], [4]).model_copy(update={"strategy": "random", "c_measure": None})
            for _ in range(2)
        )
    )
    # Clopper-Pearson's interval of 4 of 10.
    assert (summary.rate.value, summary.rate.low, summary.rate.high) == pytest.approx(
        (0.4, 0.1216, 0.7376), abs=1e-4
    )
    assert summary.c_measure is None and summary.c_measure_censored == 0


def test_campaigns_without_a_failure_count_as_censored() -> None:
    # F is 2, and above 5. With equal budgets, the restricted mean is that of 2 and 5.
    summary = over_seeds(measured([2], [4]), measured([], [4]))
    assert (summary.f_measure.value, summary.f_measure_censored) == (3.5, 1)
    # Of the baseline's four tests, the first needs two and the second more than five.
    assert summary.c_measure is not None
    assert (
        summary.c_measure.value == pytest.approx(1 - (0.5 + 1.25) / 2)
        and summary.c_measure_censored == 1
    )


def test_with_all_campaigns_censored_the_estimates_are_bounds() -> None:
    summary = over_seeds(measured([], [4]), measured([], [2]))
    assert (
        summary.f_measure.low,
        summary.f_measure.value,
        summary.f_measure.high,
        summary.f_measure_censored,
    ) == (5, 5, 5, 2)
    assert summary.c_measure is not None and (
        summary.c_measure.value,
        summary.c_measure_censored,
    ) == (1 - 5 / 2, 2)
    assert censored(summary.f_measure, 2, 2, "{:.0f}", ">") == "> 5, 2 of 2 censored"


def test_theta_table_holds_means_over_seeds() -> None:
    table = theta_table([measured([1, 2], [4]), measured([5], [])])
    assert list(table.columns) == ["tests", "F-forest"]
    assert table["F-forest"].tolist() == [0.5, 1, 1, 1, 1.5]
    assert table["tests"].tolist() == [1, 2, 3, 4, 5]


def test_step_writes_the_same_measures_twice(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make()
    contents = []
    for _ in range(2):
        study.run("measure")
        contents.append(
            [(study.root / name).read_bytes() for name in ("measures.json", "theta.csv")]
        )
    assert contents[0] == contents[1]
    result = read(study.root / "measures.json", Measures)
    assert len(result.campaigns) == 8
    for campaign in result.campaigns:
        assert (
            campaign.theta[-1] == campaign.failures == campaign.modes.total == campaign.causes.total
        )
    assert result.no_braking == ()
    for rate in result.base_rates:
        rows = [
            c for c in result.campaigns if (c.scenario, c.strategy) == (rate.scenario, "random")
        ]
        assert (rate.version, rate.failures) == ("base", sum(c.failures for c in rows))
        assert rate.rate.low < rate.failures / rate.tests < rate.rate.high
        assert (rate.strategy, rate.tests) == ("random", sum(c.tests - c.errors for c in rows))
    assert [rate.scenario for rate in result.base_rates] == [
        "F1",
        "F2",
    ] and result.base_rates == result.audit
    assert sum(campaign.errors for campaign in result.campaigns) > 0


def test_wrong_results_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "measures.json"
    path.write_text('{"confidence": 0.95')
    with pytest.raises(InputError, match="measures.json"):
        read(path, Measures)
    path.write_text(
        '{"confidence": 0.95, "baseline": "random", "campaigns": [], "strategies": [], "more": 1}'
    )
    with pytest.raises(InputError, match="more"):
        read(path, Measures)


def test_value_outside_the_space_names_the_test() -> None:
    tests = make_tests(
        SPACE_OF_STUDY,
        {"scenario": "F", "strategy": "s", "version": "base", "seed": 0},
        SPACE_OF_STUDY.sample(3, RNG),
    )
    tests.loc[1, "fog"] = 300.0
    with pytest.raises(
        InputError, match=r"test F-s-base-0-00001: fog must be in \[0, 100\] %, got"
    ):
        encode_tests(tests, SPACE_OF_STUDY)


RNG = np.random.default_rng(0)
SPACE_OF_STUDY = Space(
    (
        Variable("fog", "continuous", "%", 0, 100, 10),
        Variable("sun_altitude", "continuous", "deg", -20, 90, 10),
    )
)


def test_a_test_that_ended_in_an_error_covers_no_pair() -> None:
    tests = rows("forest", [2], errors=[1]).assign(
        fog=[100.0, 0, 0, 0, 0], gait=["run", *["walk"] * 4]
    )
    tables = {
        CampaignId("F", "random", "base", 0): rows("random", [3]),
        CampaignId("F", "forest", "base", 0): tests,
    }
    measures = measure_campaign(
        CampaignId("F", "forest", "base", 0), tables, {"F": SPACE}, "random"
    )
    assert measures.pair_coverage_tests == measures.pair_coverage_failures == pytest.approx(1 / 6)


def test_an_error_is_in_no_rate_of_a_strategy() -> None:
    forest = measured([1, 2], [4], errors=[3])
    assert over_seeds(forest, forest).rate.value == 0.5
    random = forest.model_copy(update={"strategy": "random", "c_measure": None})
    assert over_seeds(random, random).rate.value == 0.5


def test_only_independent_tests_have_the_exact_interval_whichever_is_the_baseline() -> None:
    forest = measured([1, 2], [4])
    assert summarise([forest], 0.95, "forest", ()).rate.low == 0.4, "one seed has no interval"
    assert summarise([forest], 0.95, "random", {"forest"}).rate.low == pytest.approx(
        0.0527, abs=1e-4
    )


def test_the_interval_of_the_saved_tests_contains_their_mean() -> None:
    saved = over_seeds(measured([1], [4]), measured([3], [4])).c_measure
    # A quarter and three quarters of the tests are needed: 0.5 ± 12.706 * 0.25, and no cost is
    # below 0.
    assert (
        saved is not None
        and (saved.value, saved.high) == (0.5, 1)
        and saved.low == pytest.approx(0.5 - 3.1766, abs=1e-3)
    )


def test_the_mean_curve_ends_with_the_shortest_campaign() -> None:
    short = measured([1], [4]).model_copy(update={"theta": (1, 1, 1), "seed": 1})
    (name,) = [name for name in theta_table([measured([1, 2, 5], [4]), short]) if name != "tests"]
    assert theta_table([measured([1, 2, 5], [4]), short])[name].tolist() == [1, 1.5, 1.5]
