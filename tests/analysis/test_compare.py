"""The comparison of model versions, by hand-computed cases."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.analysis.comparison import base_regions, changed_tests
from pipeline.analysis.held_out import HeldOut, read_held_out
from pipeline.artefacts.comparison_results import Comparison, read_changes, write_changes
from pipeline.artefacts.failure_counts import Causes
from pipeline.artefacts.files import read_json
from pipeline.artefacts.results import read, write
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.artefacts.tables import read_tests, write_tests
from pipeline.config.composing import compose
from pipeline.core.comparison import SequenceTest
from pipeline.errors import InputError
from pipeline.report.failure_tables import braking_held_out
from pipeline.report.verdict import verdict_table
from pipeline.report.verdict_section import headline
from tests.analysis.comparisons import (
    compared,
    compared_on,
    held_out,
    scenarios,
    table,
)
from tests.analysis.fabricated import FabricatedStudy
from tests.spaces import SMALL

LABELS = {"F1star": "F1*"}


def test_counts_pairs_and_exact_p_value() -> None:
    result = compared(base="cccccclf....", adaptive="c.......f...")
    base, adaptive = result.versions
    assert (base.failures, base.modes.contact, base.modes.by_ttc, base.verdict) == (
        8,
        6,
        7,
        "baseline",
    )
    assert adaptive.paired is not None
    assert adaptive.paired.fixes == tuple(SequenceTest("F1star", i) for i in range(1, 8))
    assert adaptive.paired.regressions == (SequenceTest("F1star", 8),)
    # Eight discordant tests, one against seven: 2 * (1 + 8) / 2 ** 8.
    assert adaptive.paired.p_value == pytest.approx(18 / 256)
    assert (adaptive.change, adaptive.verdict) == (-6, "no difference shown")
    assert result.champion == "base"
    assert (
        result.gate["adaptive"]
        == "held back: not significantly fewer failures than base (p = 0.07)"
    )


def test_a_worse_version_is_held_back_for_more_failures() -> None:
    # Eight regressions without a fix: p = 2 / 2 ** 8.
    result = compared(base="............", adaptive="cccccccc....")
    assert result.versions[1].verdict == "worse"
    assert (
        result.gate["adaptive"] == "held back: significantly more failures than base (p = 0.0078)"
    )


def test_failures_are_counted_by_cause() -> None:
    result = compared(base="cclfn.e", adaptive=".......")
    assert result.versions[0].causes == Causes(
        never_seen=2, box=1, false_positives=1, false_activation=1
    )
    assert (
        result.versions[0].modes.by_ttc,
        result.versions[0].modes.total,
        result.versions[1].causes.total,
    ) == (3, 5, 0)


def test_unnecessary_braking_is_listed_by_version_and_scenario() -> None:
    sequence = replace(
        held_out(table({"base": "nn.e", "adaptive": "...."})), no_braking=("F1star",)
    )
    result = compared_on(sequence)
    headers, base, adaptive = braking_held_out(result)
    assert dict(zip(headers, base, strict=True)) == {
        "version": "base",
        "scenario": "F1*",
        "tests": "3",
        "with a false activation": "2",
        "false activations": "2",
        "mean duration": "1.50 s",
        "mean speed loss": "4.0 m/s (14 km/h)",
    }
    assert adaptive[2:] == ("4", "0", "0", "–", "–")
    assert "Unnecessary braking" in verdict_table(
        result
    ) and "Unnecessary braking" not in verdict_table(compared(base="c"))


def test_verdicts() -> None:
    result = compared(base="cccccc......", control="............", random="cccccccccccc")
    assert [version.verdict for version in result.versions] == ["baseline", "better", "worse"]


def test_errors_do_not_count_in_pairs() -> None:
    result = compared(base="cc.e", adaptive="e.c.")
    adaptive = result.versions[1]
    assert (adaptive.tests, adaptive.errors, adaptive.failures) == (3, 1, 1)
    assert adaptive.paired is not None
    assert adaptive.paired.tests == 2
    assert (adaptive.paired.fixes, adaptive.paired.regressions) == (
        (SequenceTest("F1star", 1),),
        (SequenceTest("F1star", 2),),
    )


EIGHT, NONE = "c" * 8 + "." * 8, "." * 16


@pytest.mark.parametrize(
    ("outcomes", "champion"),
    [
        ({"base": EIGHT, "control": NONE, "random": "c" + NONE[1:]}, "control"),
        ({"base": EIGHT, "control": "l" + NONE[1:], "random": "f" + NONE[1:]}, "random"),
        ({"base": EIGHT, "control": EIGHT[2:] + ".."}, "base"),
        ({"base": NONE, "control": EIGHT}, "base"),
    ],
)
def test_champion(outcomes: dict[str, str], champion: str) -> None:
    result = compared(**outcomes)
    assert result.champion == champion
    assert result.gate["base"] == "the reference" and result.passes(champion) == (
        champion != "base"
    )


BETTER = {"base": "c" * 30 + "." * 30, "adaptive": "." * 60}


def test_a_version_that_may_be_worse_somewhere_is_held_back() -> None:
    result = compared_on(
        scenarios(F1star=BETTER, F2star={"base": "." * 60, "adaptive": "ccc" + "." * 57})
    )
    # Wilson's one-sided limit of 3 of 60, because there are no fixes.
    assert result.versions[1].verdict == "better" and result.champion == "base"
    assert result.gate["adaptive"] == (
        "held back: the failure rate may rise by up to 11.9 points (F2*), more than the "
        "margin of 10 points"
    )
    assert [
        (limit.name, limit.tests, limit.fixes, limit.regressions, limit.judgement)
        for limit in result.versions[1].limits
    ] == [
        ("F1*", 60, 30, 0, "within the margin"),
        ("F2*", 60, 0, 3, "above the margin"),
    ]
    assert result.versions[0].limits == () and result.margin == 0.4, "base fails a quarter"


@pytest.mark.parametrize(("tests", "regressions"), [(200, 12), (962, 70)])
def test_a_version_that_only_regresses_somewhere_is_held_back(tests: int, regressions: int) -> None:
    """Both limits are below 10 points, and the version is better on the whole sequence."""
    somewhere = {
        "base": "." * tests,
        "adaptive": "c" * regressions + "." * (tests - regressions),
    }
    better = {"base": "c" * tests + "." * tests, "adaptive": "." * 2 * tests}
    result = compared_on(scenarios(F1star=better, F2star=somewhere))
    limit = result.versions[1].limits[1]
    assert (limit.name, limit.tests, limit.fixes, limit.regressions) == (
        "F2*",
        tests,
        0,
        regressions,
    )
    # Exact: twice the chance that all regressions fall on one side.
    assert limit.limit < 0.1 and limit.p_value == pytest.approx(2 * 0.5**regressions)
    assert limit.judgement == "significantly worse" and result.champion == "base"
    assert result.gate["adaptive"] == (
        f"held back: significantly worse in F2* (p = {limit.p_value:.2g})"
    )


def test_significance_is_corrected_for_the_number_of_groups() -> None:
    """Six regressions without a fix have p = 0.031: enough alone, but not with ten groups."""
    sequence = scenarios(
        F1star={"base": "c" * 300 + "." * 300, "adaptive": "." * 600},
        F2star={"base": "." * 300, "adaptive": "c" * 6 + "." * 294},
    )
    alone = np.arange(900) >= 600
    groups = {f"g{number}": alone for number in range(10)}
    judgements = {limit.judgement for limit in compared_on(sequence, **groups).versions[1].limits}
    assert judgements == {"within the margin"}
    nine = scenarios(
        F1star={"base": "c" * 300 + "." * 300, "adaptive": "." * 600},
        F2star={"base": "." * 300, "adaptive": "c" * 9 + "." * 291},
    )
    limit = compared_on(nine, **groups).versions[1].limits[1]
    assert limit.judgement == "significantly worse" and limit.p_value == pytest.approx(2 / 512)


def test_a_rise_within_the_margin_passes() -> None:
    result = compared_on(
        scenarios(F1star=BETTER, F2star={"base": "." * 60, "adaptive": "cc" + "." * 58})
    )
    assert result.champion == "adaptive"
    assert result.gate["adaptive"] == (
        "passes: significantly fewer failures than base (p = 2.5e-07); the failure rate rises by "
        "at most 10 points in "
        "each judged scenario and group (95 % upper limits)"
    )


def test_a_named_group_that_may_be_worse_holds_a_version_back() -> None:
    """Five regressions of 120 tests in all, but of 30 at night, in both scenarios."""
    few = {"base": "." * 60, "adaptive": "ccc" + "." * 57}
    sequence = scenarios(
        F1star={"base": "." * 15 + "c" * 45, "adaptive": "cc" + "." * 58}, F2star=few
    )
    night = np.tile(np.arange(60) < 15, 2)
    assert compared_on(sequence, 0.15).passes("adaptive")
    result = compared_on(sequence, 0.15, night=night, day=~night)
    assert result.gate["adaptive"] == (
        "held back: the failure rate may rise by up to 30.5 points (night), more than the "
        "margin of 15 points"
    )
    assert [(limit.name, limit.tests) for limit in result.versions[1].limits] == [
        ("F1*", 60),
        ("F2*", 60),
        ("night", 30),
        ("day", 90),
    ]


def test_a_group_that_is_too_small_to_judge_is_named_and_holds_nothing_back() -> None:
    children = np.arange(60) >= 36  # 4 of these 24 tests regress.
    tests = table({"base": "c" * 36 + "." * 24, "adaptive": "." * 56 + "cccc"})
    result = compared_on(held_out(tests), children=children, adults=~children)
    assert result.gate["adaptive"].endswith(
        "rises by at most 10 points in each judged scenario and group (95 % upper limits); too "
        "small to judge: children"
    )
    assert [limit.judgement for limit in result.versions[1].limits] == [
        "within the margin",
        "too small to judge",
        "within the margin",
    ]


def test_a_version_that_passes_without_a_part_to_judge_claims_no_limit() -> None:
    assert compared(base=EIGHT, control=NONE).gate["control"] == (
        "passes: significantly fewer failures than base (p = 0.0078); too small to judge: F1*"
    )


def test_false_activations_are_limited_apart_from_failures() -> None:
    """Fewer failures among children do not make up for more false activations there."""
    brake, calm = (
        {"base": "c" * 40 + "." * 20, "adaptive": "." * 60},
        {"base": "." * 60, "adaptive": "n" * 4 + "." * 56},
    )
    sequence = replace(scenarios(F1star=brake, N1=calm), no_braking=("N1",))
    children = np.tile(np.arange(60) < 30, 2)
    result = compared_on(sequence, children=children, adults=~children)
    limits = [
        (limit.name, limit.measure, limit.tests, limit.regressions)
        for limit in result.versions[1].limits
    ]
    assert limits == [
        *[
            ("F1*", "failures", 60, 0),
            ("children", "failures", 30, 0),
            ("adults", "failures", 30, 0),
        ],
        *[
            ("N1", "false activations", 60, 4),
            ("children", "false activations", 30, 4),
            ("adults", "false activations", 30, 0),
        ],
    ]
    assert result.gate["adaptive"] == (
        "held back: the rate of false activations may rise by up to 14.0 points (N1), 26.6 points "
        "(children), more than the margin of "
        "10 points"
    )
    assert (
        "too small to judge: false activations in N1"
        in compared_on(
            replace(
                scenarios(F1star=brake, N1={"base": "..", "adaptive": ".."}), no_braking=("N1",)
            )
        ).gate["adaptive"]
    )


def test_a_reason_names_the_rate_that_was_judged() -> None:
    brake, calm = {"base": "c" * 12, "adaptive": "." * 12}, {"base": "." * 60, "adaptive": "." * 60}
    judged = compared_on(replace(scenarios(F1star=brake, N1=calm), no_braking=("N1",))).gate[
        "adaptive"
    ]
    assert (
        "; the rate of false activations rises by at most 10 points in each" in judged
        and judged.endswith("too small to judge: F1*")
    )
    both = compared_on(
        replace(
            scenarios(F1star={name: row * 5 for name, row in brake.items()}, N1=calm),
            no_braking=("N1",),
        )
    )
    assert (
        "; the failure rate and the rate of false activations rise by at most 10 points in each"
        in both.gate["adaptive"]
    )


def test_a_version_whose_other_seeds_are_no_better_is_held_back() -> None:
    seeds = {"base": "c" * 30 + "." * 30, "adaptive": "." * 60, "adaptive-s1": "c" * 29 + "." * 31}
    result = compared(**seeds)
    assert result.versions[1].verdict == "better" and result.champion == "base"
    # Differences of -30 and -1: Student's interval of two seeds is -15.5 ± 12.706 * 14.5.
    assert result.gate["adaptive"] == (
        "held back: over all its seeds, adaptive does not show fewer failures than base (-15.5, "
        "-199.7 to +168.7; p = 7.2e-05)"
    )
    alike = compared(**seeds | {"adaptive-s1": "." * 60})
    assert alike.passes("adaptive") and alike.passes("adaptive-s1")


def test_a_version_with_more_errors_is_held_back() -> None:
    result = compared(base="c" * 8 + "." * 92, control="cc" + "." * 98, adaptive="." * 8 + "e" * 92)
    assert result.gate["adaptive"] == "held back: 92 errors, 0 with base"
    assert result.champion == "control"


def test_equal_versions_show_no_difference() -> None:
    assert compared(base="cc..", control="cc..").versions[1].verdict == "no difference shown"


def test_every_pair_is_tested() -> None:
    result = compared(base="....", random="ccc.", adaptive="c..c")
    paired = result.pair("adaptive", "random")
    assert paired is not None
    assert (len(paired.fixes), len(paired.regressions)) == (2, 1)
    assert [(p.version, p.against) for p in result.pairs] == [
        ("random", "base"),
        ("adaptive", "base"),
        ("adaptive", "random"),
    ]
    assert result.pair("random", "adaptive") is None


def test_groups_average_over_the_seeds_of_retraining() -> None:
    result = compared(
        **{
            "base": "cccc....",
            "adaptive": "c.......",
            "adaptive-s1": "ccc.....",
            "adaptive-r2": "........",
        }
    )
    base, first, second = result.groups
    assert (base.group, base.failures.value, base.against_base) == ("base", 4, 1)
    assert (first.versions, first.failures.value, first.against_base) == (
        ("adaptive", "adaptive-s1"),
        2,
        0.5,
    )
    # Student's t of two seeds is wide: 2 ± 12.7, and no count is below 0.
    assert (first.failures.low, first.failures.high) == pytest.approx(
        (0, 14.706), abs=1e-3
    ) and first.scenarios["F1star"].value == 2
    assert (second.group, second.round, second.failures.value) == ("adaptive-r2", 2, 0)
    assert (base.failures.low, base.failures.high) == (4, 4), (
        "a single version on a designed list has no interval"
    )
    none = compared(base="....", adaptive="c...")
    assert none.groups[1].against_base is None


def test_a_test_that_ends_in_an_error_counts_for_no_group() -> None:
    result = compared(base="cccc....", adaptive="eecc....")
    base, adaptive = result.groups
    assert (base.failures.value, adaptive.failures.value, adaptive.against_base) == (2, 2, 1)
    assert adaptive.scenarios["F1star"].value == 2
    assert headline(result).startswith("On the held-out scenario F1*, base fails 2 of 6 tests.")


def test_groups_are_compared_over_all_seeds() -> None:
    result = compared(
        **{
            "base": "cccccc..",
            "random": "ccc...e.",
            "random-s1": "cc......",
            "adaptive": "c.......",
            "adaptive-s1": "......c.",
        }
    )
    pair = next(
        pair for pair in result.group_pairs if (pair.group, pair.against) == ("adaptive", "random")
    )
    # The error counts for no version. By test, seeds summed: -1, -2, -1, 0 ...: 2 of the 8 sign
    # patterns reach as far.
    assert (pair.tests, pair.difference.value, pair.p_value) == (7, -2, 0.25)
    assert (pair.difference.low, pair.difference.high) == pytest.approx(
        (-4.594, 0.594), abs=1e-3
    ), "counts are rounded"
    base = next(
        pair for pair in result.group_pairs if (pair.group, pair.against) == ("adaptive", "base")
    )
    # 5 failures fewer with each seed. The base fails each test with a chance of 2, five times 1 and
    # 1 in 3: 7/3 failures are expected,
    # and only 6 and 7 are as far from it as 6.
    assert (base.tests, base.difference.value) == (8, -5)
    assert base.p_value == pytest.approx((2 * 6 * 2 + 1 + 2) / 3**7)
    sentence = next(
        line
        for line in verdict_table(result, Path("report.html")).splitlines()
        if line.startswith("adaptive against random")
    )
    assert (
        "-2.0 failures, mean of 2 seeds (-4.6 to +0.6); p = 0.25, exact randomisation test"
        in sentence
    )


def test_one_seed_leaves_mcnemar() -> None:
    result = compared(base="cccc....", random="ccc.....", adaptive="c..c....")
    for pair in result.group_pairs:
        paired = result.pair(pair.group, pair.against)
        assert paired is not None and pair.p_value == pytest.approx(paired.p_value)


def test_changed_tests_are_listed_with_both_results() -> None:
    tests = table({"base": "cc.", "adaptive": "c.f"}).assign(
        adj_ttc_s=0.5, false_positives=1, first_detection_m=9.0, fog=[10, 20, 30] * 2
    )
    result = compared_on(held_out(tests))
    changes = changed_tests(result, tests, ["fog"])
    assert changes[
        ["version", "change", "index", "failure_mode_before", "failure_mode_after", "fog"]
    ].to_numpy().tolist() == [
        ["adaptive", "regression", 2, "none", "false_positives", 30],
        ["adaptive", "fix", 1, "contact", "none", 20],
    ]
    assert len(changed_tests(compared(base="..."), tests, ["fog"])) == 0


def test_failures_are_counted_in_the_regions_of_the_base() -> None:
    points = SMALL.sample(200, np.random.default_rng(0))
    points[:30] = points[0]
    rows = pd.DataFrame([SMALL.decode(point) for point in points])
    rows = rows.assign(
        index=range(200), status="ok", strategy="pairwise", seed=0, impact_speed_mps=0.0
    )
    tests = {}
    for version, failed in {
        "base": np.arange(200) < 30,
        "adaptive": np.isin(np.arange(200), [3, 4, 150]),
    }.items():
        modes = np.where(failed, "contact", "none")
        ids = [f"F1star-pairwise-{version}-0-{i:05d}" for i in range(200)]
        tests[version] = rows.assign(
            test_id=ids,
            failure=failed,
            failure_mode=modes,
            cause="box",
            adj_ttc_s=np.where(failed, 0.0, 1.0),
        )
    sequence = HeldOut(
        ("base", "adaptive"),
        LABELS,
        {("F1star", version): rows for version, rows in tests.items()},
    )
    spaces = {"F1star": (ScenarioInfo("F1star", "F1*", "", 100), SMALL)}
    (region,) = base_regions(sequence, spaces, compose("default", []).regions)
    assert (region.scenario, region.name) == ("F1star", "F1* region 1")
    assert region.failures == {"base": 30, "adaptive": 2} and 30 <= region.tests < 60
    tests["base"].loc[:9, ["status", "failure"]] = ["error", False]
    (fewer,) = base_regions(sequence, spaces, compose("default", []).regions)
    assert fewer.failures == {"base": 20, "adaptive": 0} and fewer.tests == region.tests - 10, (
        "errors of the base count for no version"
    )


def test_a_version_that_reads_like_no_value_keeps_its_name(tmp_path: Path) -> None:
    write_changes(
        tmp_path / "changes.csv",
        pd.DataFrame({"version": ["null", "NA"], "base_mode": ["contact", None]}),
    )
    assert read_changes(tmp_path / "changes.csv")["version"].tolist() == ["null", "NA"]
    assert read_changes(tmp_path / "changes.csv")["base_mode"].isna().tolist() == [False, True]


def test_step_on_files(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make_analysed()
    result = read(study.root / "comparison.json", Comparison)
    assert [version.version for version in result.versions] == [
        "base",
        "control",
        "random",
        "adaptive",
    ]
    assert result.champion == "adaptive"
    assert len(read_tests(study.root / "comparison.parquet")) == 4 * study.config.comparison.tests
    assert result.versions[3].scenarios["F1star"].failures == result.versions[3].failures
    changes = pd.read_csv(study.root / "changes.csv")
    assert (changes["version"] == "adaptive").sum() == -result.versions[3].change
    metrics = {
        str(path.relative_to(study.root / "metrics")): read_json(path)
        for path in (study.root / "metrics").rglob("*.json")
    }
    versions = {f"held_out/{version.version}.json": version for version in result.versions}
    assert metrics.keys() == {
        *versions,
        *(
            f"search/{name}-{strategy}.json"
            for name in ("F1", "F2")
            for strategy in ("mixed", "random")
        ),
    }
    assert {name: metrics[name]["failures"] for name in versions} == {
        name: version.failures for name, version in versions.items()
    }
    assert metrics["held_out/base.json"].keys() == {
        "failures",
        "tests",
        "failure_rate",
        "ap50",
        "recall",
    }
    assert metrics["held_out/base.json"]["ap50"] == 0.88
    searched = pd.concat(
        read_tests(path) for path in study.search_tests if path.parts[-5:-3] == ("F1", "random")
    )
    assert (
        metrics["search/F1-random.json"]["tests"]
        == (searched["status"] == "ok").sum()
        < len(searched)
    )
    assert metrics["search/F1-random.json"]["tests_to_first_failure"] >= 1
    text = verdict_table(result, study.root / "report.html")
    assert "adaptive ★" in text
    assert "F1*" in text
    assert text.splitlines()[-1].startswith("Next: open ")
    assert "report.html" in text
    assert "./run ui" in text


def test_a_fix_that_names_no_test_is_refused_on_reading(tmp_path: Path) -> None:
    path, result = tmp_path / "comparison.json", compared(base="ccc", adaptive="...")
    write(path, result)
    assert read(path, Comparison) == result and "F1star-00002" in path.read_text()
    path.write_text(path.read_text().replace("F1star-00002", "F1star"))
    wrong = (
        "versions.1.scenarios.F1star.paired.fixes.2: expected the name of a test, such as "
        "F1star-00042, got 'F1star'"
    )
    with pytest.raises(InputError) as caught:
        read(path, Comparison)
    assert str(caught.value) == f"{path} is not a Comparison file: {wrong}; make it again"


def test_an_unknown_key_of_a_result_is_told_with_the_nearest(tmp_path: Path) -> None:
    path = tmp_path / "comparison.json"
    write(path, compared(base="ccc", adaptive="..."))
    path.write_text(path.read_text().replace('"regressions"', '"regression"', 1))
    with pytest.raises(
        InputError,
        match=r"Comparison file: unknown key '.*\.regression'; did you mean 'regressions'\?; make "
        r"it again",
    ):
        read(path, Comparison)
    path.write_text("[]")
    with pytest.raises(InputError, match=r"Comparison file: expected .*, got \[\]; make it again"):
        read(path, Comparison)


def test_another_sequence_is_refused_with_the_first_difference(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make_analysed()
    path = study.held_out_tests[2]
    tests = read_tests(path)
    tests.loc[7, "fog"] = 41.0
    write_tests(path, tests, study.config.space("F1star"))
    with pytest.raises(
        InputError, match="version 'random' on scenario 'F1star', test 7: fog must be .* got 41"
    ):
        study.run("compare")
    write_tests(path, tests.head(59), study.config.space("F1star"))
    with pytest.raises(InputError, match="expected 60 tests as version 'base' has, got 59"):
        study.run("compare")


def test_tests_judged_at_another_threshold_are_refused(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make_analysed()
    campaign = study.config.campaign.model_copy(update={"failure_threshold_s": 0.9})
    study.config = study.config.model_copy(update={"campaign": campaign})
    with pytest.raises(
        InputError,
        match=r"tests\.parquet, test \d+: expected a failure at an adjusted TTC of 0\.9 s or below",
    ):
        study.run("compare")


def test_a_false_activation_does_not_contradict_the_threshold(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make()
    scenario = study.config.held_out[0]
    path, space, info = (
        study.held_out_tests[0],
        study.config.space(scenario),
        ScenarioInfo(scenario, "F1*", "", 1),
    )
    rows = read_tests(path)
    # Without a collision path: a false activation fails however long the TTC, and false positives
    # alone shorten it without a failure.
    rows.loc[0, ["failure", "failure_mode", "adj_ttc_s"]] = [True, "false_activation", 2.0]
    rows.loc[1, ["failure", "failure_mode", "adj_ttc_s", "false_positives"]] = [
        False,
        "none",
        0.049,
        40,
    ]
    write_tests(path, rows, space)
    read_held_out([path], ["base"], {scenario: info}, 0.1, lambda *_: None)
    rows.loc[1, "false_positives"] = 0
    write_tests(path, rows, space)
    with pytest.raises(InputError, match="test 1: expected a failure at an adjusted TTC of"):
        read_held_out([path], ["base"], {scenario: info}, 0.1, lambda *_: None)


def test_a_version_without_campaign_is_named() -> None:
    tests = {("F1star", "base"): table({"base": ".."})}
    with pytest.raises(
        InputError, match="expected a campaign of version 'control' on held-out scenario 'F1star'"
    ):
        HeldOut(("base", "control"), LABELS, tests).digest({"F1star": []})


VARIABLES = {"F1star": ["fog"]}


def digest_of(**changes: str | int) -> str:
    tests = table({"base": "c.", "adaptive": ".."}).assign(fog=[0.1234567890123, 20.0] * 2)
    changed = tests.assign(
        **{
            name: np.where(tests["version"] == "adaptive", value, tests[name])
            for name, value in changes.items()
        }
    )
    return held_out(changed).digest(VARIABLES)


def test_the_digest_of_a_sequence_knows_its_scenario_and_every_digit_of_its_values() -> None:
    tests = table({"base": "c."}).assign(fog=[0.1234567890123, 20.0])
    other = tests.assign(fog=[0.1234567890124, 20.0])
    renamed = tests.assign(scenario="F2star")
    digests = {
        held_out(tests).digest(VARIABLES),
        held_out(other).digest(VARIABLES),
        held_out(renamed).digest({"F2star": ["fog"]}),
    }
    assert len(digests) == 3 and digest_of() in digests


@pytest.mark.parametrize(("name", "value"), [("seed", 1), ("strategy", "random"), ("index", 7)])
def test_a_sequence_of_another_seed_or_strategy_is_refused(name: str, value: str | int) -> None:
    with pytest.raises(
        InputError, match=f"version 'adaptive' on scenario 'F1star', test .*: {name} must be"
    ):
        digest_of(**{name: value})


def test_an_error_is_no_failure_whatever_its_row_says() -> None:
    outcomes = held_out(
        table({"base": "ce."}).assign(failure=True, failure_mode="contact")
    ).outcomes("base")
    assert (outcomes.tests, outcomes.failures, int(outcomes.by_ttc.sum())) == (2, 2, 2)


def test_the_tests_of_a_version_are_read_in_the_order_of_the_sequence(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make()
    path, space, info = (
        study.held_out_tests[0],
        study.config.space("F1star"),
        ScenarioInfo("F1star", "F1*", "", 1),
    )
    write_tests(path, read_tests(path).iloc[::-1], space)
    read = read_held_out([path], ["base"], {"F1star": info}, 0.1, lambda *_: None)
    assert [test.index for test in read.tests] == list(range(60))
