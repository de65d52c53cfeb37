"""The verdict on the model versions as a table, for the terminal and the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pipeline.artefacts.comparison_results import Comparison, GroupPair, VersionPair, VersionResult
from pipeline.artefacts.failure_counts import Count
from pipeline.artefacts.model_card import Frequencies
from pipeline.core.lineage import Version
from pipeline.report.failure_tables import base_rate_sentence, braking_held_out
from pipeline.report.formats import aligned, counted, interval

HEADERS = ("version", "failures / tests", "difference", "p", "verdict")


def verdict_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """One row a version, columns as `HEADERS`; the champion carries a star."""
    return [_row(result, comparison) for result in comparison.versions]


def verdict_table(comparison: Comparison, report: Path | None = None) -> str:
    """The table, how to read it and, given the path of the page, where to go next."""
    scenarios = " + ".join(comparison.scenarios.values())
    lines = [
        f"Held out: {scenarios}; the same tests for every version\n",
        *aligned([HEADERS, *verdict_rows(comparison)]),
    ]
    if len(comparison.groups) < len(comparison.versions) or len(comparison.scenarios) > 1:
        lines += [
            "",
            f"Failures by scenario{_averaged(comparison)}\n",
            *aligned([group_headers(comparison), *group_rows(comparison)]),
        ]
    if planted := planted_rows(comparison):
        lines += [
            "",
            "Planted blind spots: people and poses that the base set shows rarely\n",
            *aligned(planted),
        ]
    if braking := braking_held_out(comparison):
        lines += ["", "Unnecessary braking\n", *aligned(braking)]
    lines += ["", *verdict_sentences(comparison)]
    if report is not None:
        lines += ["", f"Next: open {report} in a browser; ./run ui compares the versions in MLflow"]
    return "\n".join(lines)


def verdict_markdown(comparison: Comparison, bold: str = "") -> str:
    """The versions' table and how to read it, as Markdown. bold: the version whose row is in bold."""
    rows = []
    for result, row in zip(comparison.versions, verdict_rows(comparison), strict=True):
        rows.append([f"**{cell}**" if cell and result.version == bold else cell for cell in row])
    lines = [f"| {' | '.join(cells)} |" for cells in (HEADERS, ["---"] * len(HEADERS), *rows)]
    scenarios = " + ".join(comparison.scenarios.values())
    sentences = [f"- {sentence}" for sentence in verdict_sentences(comparison)]
    return "\n".join(
        [f"Held out: {scenarios}; the same tests for every version.", "", *lines, "", *sentences]
    )


def verdict_sentences(comparison: Comparison) -> list[str]:
    """How to read the table, and what qualifies it."""
    alpha = f"{comparison.alpha:g}"
    sentences = [*base_sentences(comparison)]
    sentences.append(
        f"★ champion: {comparison.champion}. p: exact McNemar test against {comparison.versions[0].version} on the same tests. "
        f"A difference is shown at p ≤ {alpha}, not corrected for several comparisons."
    )
    if (passing := len(comparison.passing)) > 1:
        chosen = f"{comparison.champion} is the best of {passing} versions that pass, chosen on these tests"
        sentences.append(f"{chosen}: expect more failures on new tests.")
    sentences += [
        _group_sentence(comparison, pair) for pair in comparison.group_pairs if _rivals(pair)
    ]
    sentences += second_sentences(comparison)
    sentences += [
        f"{version} {'' if comparison.passes(version) else 'is '}{reason}."
        for version, reason in comparison.gate.items()
        if version != comparison.versions[0].version
    ]
    errors = ", ".join(
        f"{result.errors} of {result.version}" for result in comparison.versions if result.errors
    )
    if errors:
        sentences.append(
            f"Tests that ended in an error do not count: {errors}. Failures by scenario leave them out for every version."
        )
    return sentences


def second_sentences(comparison: Comparison) -> list[str]:
    """Failures at the second IoU, and whether the differences shown at the first are shown there, too; nothing without a second IoU."""
    second = comparison.second
    if second is None:
        return []
    counts = ", ".join(f"{group.group} {counted(group.failures)}" for group in second.groups)
    sentences = [f"Failures at an IoU of {second.iou:g} instead of {second.first:g}: {counts}."]
    pairs = zip(comparison.group_pairs, second.group_pairs, strict=True)
    shown = [(first, again) for first, again in pairs if first.shown(comparison.alpha)]
    lost = [again for first, again in shown if not holds(first, again, comparison.alpha)]
    if shown:
        kept = len(shown) - len(lost)
        sentences.append(
            f"Differences shown at {second.first:g} that are shown at {second.iou:g}, too: {kept} of {len(shown)}."
        )
    if lost:
        listed = ", ".join(
            f"{pair.group} from {pair.against} (p = {pair.p_value:.2g})" for pair in lost
        )
        sentences.append(f"Not shown at {second.iou:g}: {listed}.")
    return sentences


def holds(first: GroupPair, again: GroupPair, alpha: float) -> bool:
    """Whether a difference shown at the first IoU is shown at the second, with the same sign."""
    return again.shown(alpha) and again.difference.value * first.difference.value > 0


def base_sentences(comparison: Comparison) -> list[str]:
    """What every result stands on: the base failure rate, and the base sets of the base and of the study."""
    rates = base_rate_sentence(comparison.base_rates)
    found = [rates] if rates else []
    if comparison.base_set is None:
        return found
    trained = (
        "an unknown base set: its card does not say"
        if comparison.trained_on is None
        else _base_set(comparison.trained_on)
    )
    own = (
        "of the same kind"
        if comparison.trained_on == comparison.base_set
        else _base_set(comparison.base_set)
    )
    return [
        *found,
        f"{comparison.versions[0].version} was trained on {trained}; this study's base set is {own}.",
    ]


def _base_set(shown: Frequencies) -> str:
    if shown.uniform:
        return "a uniform base set (all people and poses equally frequent)"
    return f"a long-tailed base set (children {shown.children:g} and crouching people {shown.crouching:g} times as frequent as others)"


def _rivals(pair: GroupPair) -> bool:
    """Whether it answers thesis chapter 7: adaptive frames against those of another arm, or against none, in the same round."""
    group, against = Version.named(pair.group), Version.named(pair.against)
    return "adaptive" in (group.arm, against.arm) and group.round == against.round


def _group_sentence(comparison: Comparison, pair: GroupPair) -> str:
    paired = comparison.pair(pair.group, pair.against)
    seeds = len(next(group.versions for group in comparison.groups if group.group == pair.group))
    if seeds == 1 and paired is not None:
        return f"{pair.group} against {pair.against}: {_outcomes(paired)} (p = {pair.p_value:.2g}, exact McNemar test)."
    mean = pair.difference
    outcome = f"{mean.value:+.1f} failures, mean of {seeds} seeds{interval(mean)}"
    p_value = f"p = {pair.p_value:.2g}, exact randomisation test over the tests, seeds summed"
    by_tests_alone = pair.p_value <= comparison.alpha and not pair.shown(comparison.alpha)
    seeds_differ = (
        "; no difference is shown, because the interval over the seeds includes 0"
        if by_tests_alone
        else ""
    )
    return f"{pair.group} against {pair.against}: {outcome}; {p_value}{seeds_differ}."


def _outcomes(paired: VersionPair) -> str:
    fixes, regressions = len(paired.fixes), len(paired.regressions)
    tests = "test" if fixes == 1 else "tests"
    return f"passes {fixes} {tests} that {paired.against} fails, fails {regressions} that {paired.against} passes"


def _row(result: VersionResult, comparison: Comparison) -> tuple[str, ...]:
    name = f"{result.version} ★" if result.version == comparison.champion else result.version
    share = f"{result.failures} / {result.tests}"
    if result.paired is None:
        return name, share, "", "", f"{result.verdict}{_kind(comparison)}"
    change = f"{result.change:+d}" if result.change else "0"
    fixes, regressions = len(result.paired.fixes), len(result.paired.regressions)
    detail = f"{change} ({fixes} {'fix' if fixes == 1 else 'fixes'}, {regressions} {'regression' if regressions == 1 else 'regressions'})"
    return name, share, detail, f"{result.paired.p_value:.2g}", result.verdict


def _kind(comparison: Comparison) -> str:
    """The kind of base that a study stands on, as `, uniform base`; empty for detectors that a study only tests."""
    if comparison.base_set is None:
        return ""
    if comparison.trained_on is None:
        return ", unknown base set"
    return ", uniform base set" if comparison.trained_on.uniform else ", long-tailed base set"


def group_headers(comparison: Comparison) -> tuple[str, ...]:
    """Headers of `group_rows`."""
    return (
        "version",
        *comparison.scenarios.values(),
        "all",
        f"ratio to {comparison.versions[0].version}",
    )


def group_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """Failures by scenario, as thesis Table 7.2; versions that differ only by the seed of retraining share a row."""
    return [
        (
            group.group,
            *(counted(group.scenarios[name]) for name in comparison.scenarios),
            counted(group.failures),
            "" if group.against_base is None else f"{group.against_base:.2f}",
        )
        for group in comparison.groups
    ]


def _averaged(comparison: Comparison) -> str:
    if comparison.base_set is None:
        return ""
    seeds = comparison.seeds
    return (
        f", means over {seeds} seeds of retraining with Student's intervals"
        if seeds > 1
        else ", one seed of retraining"
    )


def planted_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """A column for each group that the base was trained on rarely: what the searches found in it, and the failures of each version among
    its held-out tests, as failures / tests. Empty without such a group."""
    if not comparison.planted:
        return []
    strategies = list(
        dict.fromkeys(name for group in comparison.planted for name in group.searched)
    )
    versions = [result.version for result in comparison.versions]
    first = (
        "group",
        "frequency",
        *(f"search, {name}" for name in strategies),
        "named by regions",
        *(f"held out, {name}" for name in versions),
    )
    columns = []
    for group in comparison.planted:
        searched = (_share(group.searched.get(name)) for name in strategies)
        held_out = (_share(group.held_out.get(name)) for name in versions)
        columns.append(
            (
                group.group,
                f"{group.frequency:g}",
                *searched,
                _by_scenario(group.regions) or "no rule",
                *held_out,
            )
        )
    return list(zip(first, *columns, strict=True))


def _by_scenario(regions: Sequence[str]) -> str:
    """`F1: 1, 3; F2: 1` of `F1 region 1`, `F1 region 3` and `F2 region 1`."""
    numbers: dict[str, list[str]] = {}
    for region in regions:
        scenario, _, number = region.partition(" region ")
        numbers.setdefault(scenario, []).append(number)
    return "; ".join(
        f"{scenario}: {', '.join(of_scenario)}" for scenario, of_scenario in numbers.items()
    )


def _share(count: Count | None) -> str:
    return "" if count is None else f"{count.failures} / {count.tests}"
