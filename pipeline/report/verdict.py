"""The verdict on the model versions as a table, for the terminal and the report."""

from __future__ import annotations

from pathlib import Path

from pipeline.artefacts.comparison_results import Comparison, GroupPair
from pipeline.artefacts.failure_counts import Count
from pipeline.artefacts.model_card import Frequencies
from pipeline.core.lineage import Version
from pipeline.report.failure_tables import base_rate_sentence, braking_held_out
from pipeline.report.formats import aligned, counted, interval

HEADERS = ("version", "failures / tests", "difference", "p", "verdict")
PLANTED = "Planted blind spots: people and poses that the base set shows rarely\n"


def verdict_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """One row a version, columns as `HEADERS`; the champion carries a star."""
    rows: list[tuple[str, ...]] = []
    for result in comparison.versions:
        star = " ★" if result.version == comparison.champion else ""
        change, p_value, verdict = "", "", str(result.verdict)
        if result.paired is None:
            verdict += _kind_of_base(comparison)
        else:
            fixes, regressions = len(result.paired.fixes), len(result.paired.regressions)
            changed = f"{fixes} {'fix' if fixes == 1 else 'fixes'}"
            changed += f", {regressions} {'regression' if regressions == 1 else 'regressions'}"
            change = f"{result.change:+d} ({changed})" if result.change else f"0 ({changed})"
            p_value = f"{result.paired.p_value:.2g}"
        counts = f"{result.failures} / {result.tests}"
        rows.append((f"{result.version}{star}", counts, change, p_value, verdict))
    return rows


def _kind_of_base(comparison: Comparison) -> str:
    """For example `, uniform base set`; empty for detectors that a study only tests."""
    if comparison.base_set is None:
        return ""
    if comparison.trained_on is None:
        return ", unknown base set"
    return ", uniform base set" if comparison.trained_on.uniform else ", long-tailed base set"


def verdict_table(comparison: Comparison, report: Path | None = None) -> str:
    """The table of the versions, how to read it, and where to go next.

    Args:
        comparison: The compared versions.
        report: Path of the HTML report; with None, the line on the next step is left out.
    """
    scenarios = " + ".join(comparison.scenarios.values())
    lines = [
        f"Held out: {scenarios}; the same tests for every version\n",
        *aligned([HEADERS, *verdict_rows(comparison)]),
    ]
    if len(comparison.groups) < len(comparison.versions) or len(comparison.scenarios) > 1:
        averaged = ""
        if comparison.base_set is not None:
            averaged = ", one seed of retraining"
            if comparison.seeds > 1:
                means = f"means over {comparison.seeds} seeds of retraining"
                averaged = f", {means} with Student's intervals"
        rows = [group_headers(comparison), *group_rows(comparison)]
        lines += ["", f"Failures by scenario{averaged}\n", *aligned(rows)]
    if planted := planted_rows(comparison):
        lines += ["", PLANTED, *aligned(planted)]
    if braking := braking_held_out(comparison):
        lines += ["", "Unnecessary braking\n", *aligned(braking)]
    lines += ["", *verdict_sentences(comparison)]
    if report is not None:
        lines += ["", f"Next: open {report} in a browser; ./run ui compares the versions in MLflow"]
    return "\n".join(lines)


def verdict_markdown(comparison: Comparison, bold: str = "") -> str:
    """The table of the versions and how to read it, as Markdown.

    Args:
        comparison: The compared versions.
        bold: Version whose row is set in bold.
    """
    scenarios = " + ".join(comparison.scenarios.values())
    lines = [f"Held out: {scenarios}; the same tests for every version.", ""]
    rows = [HEADERS, ("---",) * len(HEADERS)]
    for result, row in zip(comparison.versions, verdict_rows(comparison), strict=True):
        if result.version == bold:
            row = tuple(f"**{cell}**" if cell else cell for cell in row)
        rows.append(row)
    lines += [f"| {' | '.join(cells)} |" for cells in rows]
    sentences = [f"- {sentence}" for sentence in verdict_sentences(comparison)]
    return "\n".join([*lines, "", *sentences])


def verdict_sentences(comparison: Comparison) -> list[str]:
    """How to read the table, and what qualifies it."""
    base = comparison.versions[0].version
    sentences = [
        *_base_sentences(comparison),
        f"★ champion: {comparison.champion}. p: exact McNemar test against {base} on the same "
        f"tests. A difference is shown at p ≤ {comparison.alpha:g}, not corrected for several "
        "comparisons.",
    ]
    if (passing := len(comparison.passing)) > 1:
        sentences.append(
            f"{comparison.champion} is the best of {passing} versions that pass, chosen on these "
            "tests: expect more failures on new tests."
        )
    for pair in comparison.group_pairs:
        # Thesis chapter 7: adaptive frames against another arm, or against none, in one round.
        group, against = Version.named(pair.group), Version.named(pair.against)
        if "adaptive" in (group.arm, against.arm) and group.round == against.round:
            sentences.append(_group_sentence(comparison, pair))
    sentences += _second_sentences(comparison)
    for version, reason in comparison.gate.items():
        if version != base:
            verb = "" if comparison.passes(version) else "is "
            sentences.append(f"{version} {verb}{reason}.")
    erroneous = [result for result in comparison.versions if result.errors]
    if erroneous:
        errors = ", ".join(f"{result.errors} of {result.version}" for result in erroneous)
        sentences.append(
            f"Tests that ended in an error do not count: {errors}. Failures by scenario leave them "
            "out for every version."
        )
    return sentences


def _second_sentences(comparison: Comparison) -> list[str]:
    """Whether the differences shown at the first IoU hold at the second, if there is one."""
    second = comparison.second
    if second is None:
        return []
    counts = ", ".join(f"{group.group} {counted(group.failures)}" for group in second.groups)
    sentences = [f"Failures at an IoU of {second.iou:g} instead of {second.first:g}: {counts}."]
    pairs = zip(comparison.group_pairs, second.group_pairs, strict=True)
    shown = [(first, again) for first, again in pairs if first.shown(comparison.alpha)]
    lost = [again for first, again in shown if not holds(first, again, comparison.alpha)]
    if shown:
        sentences.append(
            f"Differences shown at {second.first:g} that are shown at {second.iou:g}, too: "
            f"{len(shown) - len(lost)} of {len(shown)}."
        )
    if lost:
        listed = [f"{pair.group} from {pair.against} (p = {pair.p_value:.2g})" for pair in lost]
        sentences.append(f"Not shown at {second.iou:g}: {', '.join(listed)}.")
    return sentences


def holds(first: GroupPair, again: GroupPair, alpha: float) -> bool:
    """Whether a difference shown at the first IoU is shown at the second, with the same sign."""
    return again.shown(alpha) and again.difference.value * first.difference.value > 0


def _base_sentences(comparison: Comparison) -> list[str]:
    """The base failure rate, and the base sets of the base and of the study."""
    rates = base_rate_sentence(comparison.base_rates)
    sentences = [rates] if rates else []
    if comparison.base_set is not None:
        trained = "an unknown base set: its card does not say"
        if comparison.trained_on is not None:
            trained = _base_set(comparison.trained_on)
        of_study = "of the same kind"
        if comparison.trained_on != comparison.base_set:
            of_study = _base_set(comparison.base_set)
        base = comparison.versions[0].version
        sentences.append(f"{base} was trained on {trained}; this study's base set is {of_study}.")
    return sentences


def _base_set(frequencies: Frequencies) -> str:
    if frequencies.uniform:
        return "a uniform base set (all people and poses equally frequent)"
    return (
        f"a long-tailed base set (children {frequencies.children:g} and crouching people "
        f"{frequencies.crouching:g} times as frequent as others)"
    )


def _group_sentence(comparison: Comparison, pair: GroupPair) -> str:
    """The outcome of one pair of groups: of their tests with one seed, of their means with more."""
    paired = comparison.pair(pair.group, pair.against)
    seeds = len(next(group.versions for group in comparison.groups if group.group == pair.group))
    if seeds == 1 and paired is not None:
        tests = "test" if len(paired.fixes) == 1 else "tests"
        return (
            f"{pair.group} against {pair.against}: passes {len(paired.fixes)} {tests} that "
            f"{paired.against} fails, fails {len(paired.regressions)} that {paired.against} passes "
            f"(p = {pair.p_value:.2g}, exact McNemar test)."
        )
    mean = pair.difference
    outcome = f"{mean.value:+.1f} failures, mean of {seeds} seeds{interval(mean)}"
    p_value = f"p = {pair.p_value:.2g}, exact randomisation test over the tests, seeds summed"
    caveat = ""
    if pair.p_value <= comparison.alpha and not pair.shown(comparison.alpha):
        caveat = "; no difference is shown, because the interval over the seeds includes 0"
    return f"{pair.group} against {pair.against}: {outcome}; {p_value}{caveat}."


def group_headers(comparison: Comparison) -> tuple[str, ...]:
    """Headers of `group_rows`."""
    ratio = f"ratio to {comparison.versions[0].version}"
    return ("version", *comparison.scenarios.values(), "all", ratio)


def group_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """Failures by scenario, as thesis Table 7.2.

    Versions that differ only by the seed of retraining share a row.
    """
    rows = []
    for group in comparison.groups:
        scenarios = (counted(group.scenarios[name]) for name in comparison.scenarios)
        ratio = "" if group.against_base is None else f"{group.against_base:.2f}"
        rows.append((group.group, *scenarios, counted(group.failures), ratio))
    return rows


def planted_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """A column for each group that the base set shows rarely; empty without such a group.

    The rows: its frequency, failures / tests in each search, the regions that name it, and failures
    / tests of each version on the held-out tests.
    """
    if not comparison.planted:
        return []
    strategies: dict[str, None] = {}
    for group in comparison.planted:
        strategies |= dict.fromkeys(group.searched)
    searches = (f"search, {name}" for name in strategies)
    versions = [result.version for result in comparison.versions]
    held_out = (f"held out, {name}" for name in versions)
    columns = [("group", "frequency", *searches, "named by regions", *held_out)]
    for group in comparison.planted:
        searched = (_share(group.searched.get(name)) for name in strategies)
        # `F1: 1, 3; F2: 1` of `F1 region 1`, `F1 region 3` and `F2 region 1`.
        numbers: dict[str, list[str]] = {}
        for region in group.regions:
            scenario, _, number = region.partition(" region ")
            numbers.setdefault(scenario, []).append(number)
        regions = (
            "; ".join(f"{scenario}: {', '.join(listed)}" for scenario, listed in numbers.items())
            or "no rule"
        )
        tested = (_share(group.held_out.get(name)) for name in versions)
        columns.append((group.group, f"{group.frequency:g}", *searched, regions, *tested))
    return list(zip(*columns, strict=True))


def _share(count: Count | None) -> str:
    return "" if count is None else f"{count.failures} / {count.tests}"
