"""The verdict as text, for a handwritten comparison."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from pipeline.artefacts.comparison_results import (
    Comparison,
    GroupPair,
    GroupResult,
    LimitResult,
    ScenarioResult,
    SecondIou,
    VersionPair,
    VersionResult,
)
from pipeline.artefacts.failure_counts import Causes, FalseActivations, Modes
from pipeline.artefacts.model_card import Frequencies
from pipeline.artefacts.results import Estimate
from pipeline.artefacts.search_results import BaseRate
from pipeline.core.comparison import SequenceTest, Verdict
from pipeline.core.gate import Judgement, Measure
from pipeline.report.failure_tables import base_rate_sentence
from pipeline.report.formats import signed
from pipeline.report.page import Table
from pipeline.report.verdict import (
    HEADERS,
    group_headers,
    group_rows,
    verdict_rows,
    verdict_sentences,
    verdict_table,
)
from pipeline.report.verdict_section import headline, verdict_section


def paired(version: str, against: str, fixes: int, regressions: int, p_value: float) -> VersionPair:
    tests = [SequenceTest("F1star", index) for index in range(fixes + regressions)]
    return VersionPair(
        version=version,
        against=against,
        tests=150,
        fixes=tuple(tests[:fixes]),
        regressions=tuple(tests[fixes:]),
        p_value=p_value,
    )


RATE = 0.1


def result(
    version: str,
    failures: int,
    verdict: Verdict,
    pair: VersionPair | None = None,
    errors: int = 0,
    limits: tuple[LimitResult, ...] = (),
) -> VersionResult:
    return VersionResult(
        version=version,
        tests=150 - errors,
        errors=errors,
        failures=failures,
        modes=Modes(contact=failures),
        causes=Causes(never_seen=failures),
        group=version.partition("-s")[0],
        round=0 if version == "base" else 1,
        scenarios={
            "F1star": ScenarioResult(
                tests=150 - errors,
                failures=failures,
                rate=RATE,
                false_activations=FalseActivations(tests=150 - errors),
                paired=pair,
            )
        },
        rate=RATE,
        change=0 if pair is None else len(pair.regressions) - len(pair.fixes),
        paired=pair,
        verdict=verdict,
        limits=limits,
    )


def group(name: str, low: float, high: float, ratio: float) -> GroupResult:
    mean = Estimate(value=(low + high) / 2, low=low, high=high)
    versions = (name,) if low == high else (name, f"{name}-s1")
    return GroupResult(
        group=name,
        round=1,
        versions=versions,
        tests=150,
        failures=mean,
        scenarios={"F1star": mean},
        against_base=ratio,
    )


def group_pair(name: str, against: str, p_value: float) -> GroupPair:
    return GroupPair(
        group=name,
        against=against,
        tests=150,
        difference=Estimate(value=-15, low=-18, high=-12),
        p_value=p_value,
    )


def comparison(*, errors: int = 0, against_random: bool = True, seeds: int = 2) -> Comparison:
    return Comparison(
        strategy="pairwise",
        scenarios={"F1star": "F1*"},
        sequence_digest="digest",
        confidence=0.95,
        alpha=0.05,
        margin=0.5,
        versions=(
            result("base", 20, "baseline"),
            result("control", 20, "no difference shown", paired("control", "base", 2, 2, 1.0)),
            result(
                "random", 23, "no difference shown", paired("random", "base", 1, 4, 0.375), errors
            ),
            result("adaptive", 8, "better", paired("adaptive", "base", 12, 0, 0.00048828125)),
        ),
        groups=(
            group("base", 20, 20, 1.0),
            group("adaptive", 6, 10, 0.4) if seeds > 1 else group("adaptive", 8, 8, 0.4),
        ),
        group_pairs=(group_pair("adaptive", "random", 2 / 2**15), group_pair("random", "base", 0.1))
        if against_random
        else (),
        pairs=(paired("adaptive", "random", 15, 0, 2 / 2**15),) if against_random else (),
        regions=(),
        champion="adaptive",
        gate={
            "base": "the reference",
            "control": "held back: so",
            "random": "held back: so",
            "adaptive": "passes: so",
        },
        passing=("adaptive",),
    )


def at_second_iou(difference: float, p_value: float) -> Comparison:
    """A comparison of two groups, shown to differ by -15 at the first IoU."""
    first, groups = comparison(seeds=1), (group("base", 12, 12, 1.0), group("adaptive", 5, 5, 0.4))
    pair = group_pair("adaptive", "base", 0.001)
    again = pair.model_copy(
        update={
            "difference": Estimate(value=difference, low=difference, high=difference),
            "p_value": p_value,
        }
    )
    second = SecondIou(iou=0.3, first=0.5, groups=groups, group_pairs=(again,))
    return first.model_copy(update={"group_pairs": (pair,), "second": second})


@pytest.mark.parametrize(
    ("difference", "p_value", "holds"), [(-7, 0.02, True), (-7, 0.2, False), (7, 0.02, False)]
)
def test_a_difference_holds_at_the_second_iou_if_it_is_shown_there_with_the_same_sign(
    difference: float, p_value: float, holds: bool
) -> None:
    compared = at_second_iou(difference, p_value)
    text = " ".join(verdict_sentences(compared))
    assert "Failures at an IoU of 0.3 instead of 0.5: base 12, adaptive 5." in text
    assert f"Differences shown at 0.5 that are shown at 0.3, too: {int(holds)} of 1." in text
    assert (f"Not shown at 0.3: adaptive from base (p = {p_value})." in text) != holds
    assert (
        "The differences shown at an IoU of 0.5 are shown at 0.3, too." in headline(compared)
    ) == holds
    assert (
        "The differences shown at an IoU of 0.5 are not shown at 0.3 for adaptive."
        in headline(compared)
    ) != holds


def test_a_difference_without_a_spread_has_no_interval() -> None:
    assert signed(Estimate(value=-15, low=-18, high=-12)) == "-15.0 (-18.0 to -12.0)"
    assert signed(Estimate(value=-15, low=-15, high=-15)) == "-15.0"


def test_rows_show_failures_change_and_verdict() -> None:
    assert verdict_rows(comparison()) == [
        ("base", "20 / 150", "", "", "baseline"),
        ("control", "20 / 150", "0 (2 fixes, 2 regressions)", "1", "no difference shown"),
        ("random", "23 / 150", "+3 (1 fix, 4 regressions)", "0.38", "no difference shown"),
        ("adaptive ★", "8 / 150", "-12 (12 fixes, 0 regressions)", "0.00049", "better"),
    ]


def test_columns_are_aligned_under_their_headers() -> None:
    lines = verdict_table(comparison(), Path("data/default/report.html")).splitlines()
    header = next(index for index, line in enumerate(lines) if line.startswith("version"))
    starts = [lines[header].index(name) for name in HEADERS]
    for line, row in zip(lines[header + 2 : header + 6], verdict_rows(comparison()), strict=True):
        assert all(line[start:].startswith(cell) for start, cell in zip(starts, row, strict=True))
        assert line == line.rstrip()


def test_failures_by_scenario_are_means_over_seeds() -> None:
    assert group_headers(comparison()) == ("version", "F1*", "all", "ratio to base")
    assert group_rows(comparison()) == [
        ("base", "20", "20", "1.00"),
        ("adaptive", "8 (6–10)", "8 (6–10)", "0.40"),
    ]
    retrained = comparison().model_copy(update={"base_set": Frequencies(children=1, crouching=1)})
    assert "Failures by scenario, means over 2 seeds of retraining" in verdict_table(
        retrained, Path("report.html")
    )


def test_detectors_that_were_not_retrained_have_no_seeds_of_retraining() -> None:
    tested = comparison()
    first = tested.versions[0].model_copy(update={"version": "mine"})
    scenarios = {"F1star": "F1*", "F2star": "F2*"}
    counts = [
        group.model_copy(update={"scenarios": dict.fromkeys(scenarios, group.failures)})
        for group in tested.groups
    ]
    several = {
        "base_set": None,
        "versions": (first, *tested.versions[1:]),
        "scenarios": scenarios,
        "groups": tuple(counts),
    }
    text = verdict_table(tested.model_copy(update=several))
    assert "Failures by scenario\n" in text and "ratio to mine" in text and "retraining" not in text


def test_first_line_names_the_scenario_and_last_the_next_step() -> None:
    lines = verdict_table(comparison(), Path("data/default/report.html")).splitlines()
    assert lines[0] == "Held out: F1*; the same tests for every version"
    assert lines[-1] == (
        "Next: open data/default/report.html in a browser; ./run ui compares the versions in MLflow"
    )


def test_sentences_name_level_and_adaptive_against_random() -> None:
    champion, against, *reasons = verdict_sentences(comparison(seeds=1))
    assert reasons == [
        "control is held back: so.",
        "random is held back: so.",
        "adaptive passes: so.",
    ]
    assert champion == (
        "★ champion: adaptive. p: exact McNemar test against base on the same tests. "
        "A difference is shown at p ≤ 0.05, not corrected for several comparisons."
    )
    outcome = "passes 15 tests that random fails, fails 0 that random passes"
    assert against == f"adaptive against random: {outcome} (p = 6.1e-05, exact McNemar test)."


def limit(
    measure: Measure, name: str, tests: int, value: float, judgement: Judgement
) -> LimitResult:
    return LimitResult(
        name=name,
        measure=measure,
        tests=tests,
        fixes=0,
        regressions=0,
        p_value=1.0,
        limit=value,
        judgement=judgement,
    )


def test_the_limits_of_the_gate_are_a_folded_table() -> None:
    random = (
        limit("failures", "F1*", 150, 0.142, "above the margin"),
        limit("false activations", "night", 24, 0.5, "too small to judge"),
    )
    adaptive = (
        limit("failures", "F1*", 147, -0.04, "within the margin"),
        limit("false activations", "night", 24, 0.1, "too small to judge"),
    )
    base = comparison()
    versions = (
        base.versions[0],
        result("random", 3, "better", limits=random),
        result("adaptive", 2, "better", limits=adaptive),
    )
    section = verdict_section(
        base.model_copy(update={"versions": versions}), pd.DataFrame(), [], None, [], []
    )
    (part,) = (part for part in section.parts if part.folded.startswith("The gate"))
    assert part.table == Table(
        ("scenario or group", "tests", "random", "adaptive"),
        (
            ("F1*", "147–150", "14.2 % (above)", "-4.0 %"),
            ("night, false activations", "24", "too small", "too small"),
        ),
        numbers=(2, 3),
    )
    assert "95 %" in part.text and " points, 0.5 of the failure rate of base" in part.text
    assert not any(
        part.folded
        for part in verdict_section(comparison(seeds=1), pd.DataFrame(), [], None, [], []).parts
        if "gate" in part.folded
    )


def test_several_seeds_are_judged_together() -> None:
    _, against, *_ = verdict_sentences(comparison())
    assert against == (
        "adaptive against random: -15.0 failures, mean of 2 seeds (-18.0 to -12.0); "
        "p = 6.1e-05, exact randomisation test over the tests, seeds summed."
    )


def test_a_difference_within_the_variation_of_seeds_is_not_shown() -> None:
    sure = GroupPair(
        group="a",
        against="b",
        tests=9,
        difference=Estimate(value=-15, low=-18, high=-12),
        p_value=0.01,
    )
    assert sure.shown(0.05) and not sure.shown(0.005)
    wide = sure.model_copy(update={"difference": Estimate(value=-15, low=-31, high=1)})
    assert not wide.shown(0.05)
    single = comparison()
    pairs = tuple(
        pair.model_copy(update={"difference": wide.difference}) for pair in single.group_pairs
    )
    sentence = verdict_sentences(single.model_copy(update={"group_pairs": pairs}))[1]
    assert sentence.endswith(
        "seeds summed; no difference is shown, because the interval over the seeds includes 0."
    )


def test_the_best_of_several_is_reported_as_chosen_on_these_tests() -> None:
    single = comparison()
    both = single.model_copy(update={"passing": ("random", "adaptive")})
    chosen = (
        "adaptive is the best of 2 versions that pass, chosen on these tests: expect more "
        "failures on new tests."
    )
    assert verdict_sentences(both)[1] == chosen
    assert chosen not in verdict_sentences(single)


def test_errors_are_reported_only_if_there_are_some() -> None:
    assert len(verdict_sentences(comparison(against_random=False))) == 4
    assert verdict_sentences(comparison(errors=3))[-1] == (
        "Tests that ended in an error do not count: 3 of random. Failures by scenario leave them "
        "out for every version."
    )


RARE = Frequencies(children=0.15, crouching=0.15)
EVEN = Frequencies(children=1, crouching=1)


def test_of_many_base_failure_rates_the_lowest_and_the_highest_are_told() -> None:
    rates = [
        BaseRate(
            scenario=f"F{n}",
            version="base",
            strategy="random",
            tests=60,
            failures=n,
            rate=Estimate(value=n / 60, low=0.01, high=0.2),
        )
        for n in (2, 3, 1, 6)
    ]
    text = (
        "Base failure rate (base, random tests): from F1 1 / 60 = 1.7 % (1.0 to 20.0) to F6 6 / "
        "60 = 10.0 % (1.0 to 20.0), in 4 scenarios."
    )
    assert base_rate_sentence(rates) == text
    assert "F2 2 / 60 = 3.3 %" in base_rate_sentence(
        rates[:3]
    ) and "scenarios" not in base_rate_sentence(rates[:3])


def test_the_verdict_says_the_base_failure_rate_and_which_base_it_stands_on() -> None:
    rate = BaseRate(
        scenario="F1",
        version="base",
        strategy="random",
        tests=1600,
        failures=40,
        rate=Estimate(value=0.025, low=0.0184, high=0.0339),
    )
    described = comparison().model_copy(
        update={"base_rates": (rate,), "trained_on": RARE, "base_set": EVEN}
    )
    assert verdict_sentences(described)[:2] == [
        "Base failure rate (base, random tests): F1 40 / 1,600 = 2.5 % (1.8 to 3.4).",
        "base was trained on a long-tailed base set (children 0.15 and crouching people 0.15 "
        "times as frequent as others); "
        "this study's base set is a uniform base set (all people and poses equally frequent).",
    ]
    alike = verdict_sentences(described.model_copy(update={"base_set": RARE}))[1]
    assert alike.endswith(
        "times as frequent as others); this study's base set is of the same kind."
    )
    assert verdict_rows(described)[0][-1] == "baseline, long-tailed base set"
    assert (
        verdict_rows(described.model_copy(update={"trained_on": EVEN}))[0][-1]
        == "baseline, uniform base set"
    )
    unknown = described.model_copy(update={"trained_on": None})
    assert verdict_rows(unknown)[0][-1] == "baseline, unknown base set"
    assert (
        "base was trained on an unknown base set: its card does not say"
        in verdict_sentences(unknown)[1]
    )
