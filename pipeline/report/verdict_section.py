"""The report's headline and its verdict section: the model versions compared."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.tables import is_valid
from pipeline.report import texts
from pipeline.report.failure_tables import CAUSES, base_rate_sentence, braking_held_out, cause_cells
from pipeline.report.formats import counted, mean_text, share, signed
from pipeline.report.page import BeforeAfter, Drawing, Film, Passage, Section, Table
from pipeline.report.style import MODE_NAMES
from pipeline.report.verdict import (
    HEADERS,
    group_headers,
    group_rows,
    holds,
    planted_rows,
    verdict_rows,
    verdict_sentences,
)

CHANGES = 20
"""Rows shown of changes.csv."""


def headline(comparison: Comparison) -> str:
    """The result in words: failures of base, then the other versions by verdict.

    Versions that differ only by the seed of retraining count as one.
    """
    base = comparison.groups[0]
    *most, last = comparison.scenarios.values()
    where = f"scenarios {', '.join(most)} and {last}" if most else f"scenario {last}"
    failures = f"{mean_text(base.failures.value)} of {base.tests} tests"
    parts = [
        f"On the held-out {where}, {base.group} fails {failures}.",
        base_rate_sentence(comparison.base_rates),
        *_against_base(comparison),
        _at_second_iou(comparison),
    ]
    if comparison.seeds > 1:
        seeds = f"{comparison.seeds} seeds of retraining"
        parts.append(f"Failures of retrained versions are means over {seeds}.")
    return " ".join(filter(None, parts))


def _against_base(comparison: Comparison) -> list[str]:
    """A sentence for each verdict on groups that some group has."""
    failures = {}
    for group in comparison.groups:
        failures[group.group] = f"{group.group} {mean_text(group.failures.value)}"
    base = comparison.groups[0].group
    pairs = [pair for pair in comparison.group_pairs if pair.against == base]
    shown = [pair for pair in pairs if pair.shown(comparison.alpha)]
    by_verdict = {
        f"Fewer failures than {base}": [pair for pair in shown if pair.difference.value < 0],
        f"More failures than {base}": [pair for pair in shown if pair.difference.value > 0],
        f"Not shown to differ from {base}": [pair for pair in pairs if pair not in shown],
    }
    sentences = []
    for verdict, chosen in by_verdict.items():
        if chosen:
            sentences.append(f"{verdict}: {', '.join(failures[pair.group] for pair in chosen)}.")
    return sentences


def _at_second_iou(comparison: Comparison) -> str:
    """Whether the differences from base hold at the second IoU; empty without any or without it."""
    second, base = comparison.second, comparison.groups[0].group
    if second is None:
        return ""
    shown, lost = 0, []
    for first, again in zip(comparison.group_pairs, second.group_pairs, strict=True):
        if first.against == base and first.shown(comparison.alpha):
            shown += 1
            if not holds(first, again, comparison.alpha):
                lost.append(first.group)
    if not shown:
        return ""
    outcome = f"shown at {second.iou:g}, too"
    if lost:
        outcome = f"not shown at {second.iou:g} for {', '.join(lost)}"
    return f"The differences shown at an IoU of {second.first:g} are {outcome}."


def verdict_section(
    comparison: Comparison,
    changes: pd.DataFrame,
    plots: Sequence[Drawing],
    rounds: Passage | None,
    stills: Sequence[BeforeAfter],
    replays: Sequence[Film],
) -> Section:
    """The comparison of the model versions.

    Args:
        comparison: The compared versions.
        changes: Rows of changes.csv, with `test_id`.
        plots: Figures of the comparison.
        rounds: The part made by `rounds_part`, or None.
        stills: Fixes, before and after.
        replays: Films of a regression.
    """
    base = comparison.versions[0].version
    parts = [Passage(table=Table(HEADERS, tuple(verdict_rows(comparison)), numbers=(1, 2, 3)))]
    if stills:
        title = "More fixes, before and after"
        parts.append(Passage(title, texts.STILLS, stills=tuple(stills)))
    if planted := planted_rows(comparison):
        table = Table(planted[0], tuple(planted[1:]))
        parts.append(Passage("Planted blind spots", texts.PLANTED, table))
    sentences = tuple(verdict_sentences(comparison))
    parts.append(Passage("What the verdict rests on", notes=sentences))
    parts += _limits(comparison)
    by_scenario = Table(group_headers(comparison), tuple(group_rows(comparison)))
    parts.append(Passage("By scenario", texts.TABLE, by_scenario))
    if rounds is not None:
        parts.append(rounds)
    parts.append(_modes(comparison, plots))
    causes = [(r.version, str(r.failures), *cause_cells(r.causes)) for r in comparison.versions]
    table = Table(("version", "failures", *CAUSES.values()), tuple(causes))
    parts.append(Passage("Failures by cause", texts.CAUSES, table))
    if braking := braking_held_out(comparison):
        table = Table(braking[0], tuple(braking[1:]), numbers=(5, 6))
        parts.append(Passage("Unnecessary braking", texts.BRAKING, table))
    parts += [*_second_iou(comparison), *_every_pair(comparison)]
    if comparison.regions:
        text = texts.HELD_OUT_REGIONS.format(base=base)
        parts.append(Passage(f"Failure regions of {base}", text, _regions(comparison)))
    if len(changes):
        parts.append(_changes(changes, comparison))
    if replays:
        parts.append(Passage("Replays of a regression", texts.PAIR, replays=tuple(replays)))
    introduction = texts.VERDICT
    if any(group.group.partition("-")[0] == "control" for group in comparison.groups):
        introduction += f" {texts.CONTROL}"
    return Section("Verdict", (introduction,), tuple(parts))


def rounds_part(searched: pd.DataFrame, plots: Sequence[Drawing]) -> Passage:
    """Failures after each round, and the failures that its searches found.

    Args:
        searched: Rows of all campaigns that versions learn from.
        plots: Figure of the failures by round.
    """
    valid, rows = searched[is_valid(searched)], []
    for (version, strategy), tests in valid.groupby(["version", "strategy"], sort=False):
        failures = int(tests["failure"].sum())
        counts = (f"{failures} / {len(tests)}", share(failures / len(tests)))
        rows.append((str(version), str(strategy), *counts))
    headers = ("searched version", "strategy", "failures / tests", "failure rate")
    table = Table(headers, tuple(rows), numbers=(2, 3))
    return Passage("Round by round", texts.ROUNDS, table, tuple(plots))


def _modes(comparison: Comparison, plots: Sequence[Drawing]) -> Passage:
    rows = []
    for result in comparison.versions:
        modes = result.modes
        by_ttc = (modes.total, modes.contact, modes.late, modes.by_ttc)
        counts = map(str, (*by_ttc, modes.false_positives, modes.false_activation))
        rows.append((result.version, *counts, share(result.rate), str(result.errors)))
    modes_headers = ("contact", "late", "by TTC alone", "false positives alone")
    headers = ("version", "failures", *modes_headers, "unnecessary braking", "failure rate")
    table = Table((*headers, "errors"), tuple(rows), numbers=(7,))
    return Passage("Failure modes", texts.MODES, table, tuple(plots))


def _second_iou(comparison: Comparison) -> list[Passage]:
    """Failures of the groups at both IoUs; nothing without a second one."""
    second, base = comparison.second, comparison.groups[0].group
    if second is None:
        return []
    pairs = {(pair.group, pair.against): pair for pair in second.group_pairs}
    rows = []
    for first, again in zip(comparison.groups, second.groups, strict=True):
        pair = pairs.get((again.group, base))
        change = (signed(pair.difference), f"{pair.p_value:.2g}") if pair else ("", "")
        rows.append((first.group, counted(first.failures), counted(again.failures), *change))
    failures = (f"failures at {second.first:g}", f"failures at {second.iou:g}")
    headers = ("version", *failures, f"difference from {base} at {second.iou:g}", "p")
    text = texts.SECOND_IOU.format(first=second.first, second=second.iou)
    return [Passage("At another IoU", text, Table(headers, tuple(rows), numbers=(3,)))]


def _limits(comparison: Comparison) -> list[Passage]:
    """The limits that the gate compares with the margin, folded; nothing for the base alone."""
    judged = [result for result in comparison.versions if result.limits]
    if not judged:
        return []
    rows = []
    for limits in zip(*(result.limits for result in judged), strict=True):
        first = limits[0]
        name = first.name if first.measure == "failures" else f"{first.name}, {first.measure}"
        # Versions with errors in a scenario or group have fewer tests there.
        tests = sorted({limit.tests for limit in limits})
        row = [name, "–".join(map(str, dict.fromkeys((tests[0], tests[-1]))))]
        for limit in limits:
            text = share(limit.limit)
            if limit.judgement == "too small to judge":
                text = "too small"
            elif limit.judgement == "above the margin":
                text += " (above)"
            elif limit.judgement == "significantly worse":
                text += " (worse)"
            row.append(text)
        rows.append(tuple(row))
    headers = ("scenario or group", "tests", *(result.version for result in judged))
    text = texts.LIMITS.format(
        base=comparison.versions[0].version,
        confidence=100 * comparison.confidence,
        margin=comparison.margin,
        allowed=100 * comparison.margin * comparison.versions[0].rate,
    )
    table = Table(headers, tuple(rows), numbers=tuple(range(2, len(judged) + 2)))
    title = "The gate: how far the failure rate may rise, by scenario and group"
    return [Passage("", text, table, folded=f"{title} ({len(rows)})")]


def _every_pair(comparison: Comparison) -> list[Passage]:
    """All pairs of versions; with several seeds the pairs of groups, and the single ones folded."""
    rows = []
    for pair in comparison.pairs:
        changes = str(len(pair.fixes)), str(len(pair.regressions))
        rows.append((pair.version, pair.against, *changes, f"{pair.p_value:.2g}"))
    single = Table(("version", "against", "fixes", "regressions", "p"), tuple(rows))
    if len(comparison.groups) == len(comparison.versions):
        return [Passage("All pairs of versions", texts.PAIRS, single)]
    pooled = []
    for group in comparison.group_pairs:
        difference = signed(group.difference)
        pooled.append((group.group, group.against, difference, f"{group.p_value:.2g}"))
    headers = ("versions", "against", "difference in failures", "p")
    groups = Table(headers, tuple(pooled), numbers=(2,))
    text = texts.GROUP_PAIRS.format(alpha=comparison.alpha)
    folded = f"All pairs of single versions ({len(rows)})"
    return [
        Passage("All pairs of versions, seeds together", text, groups),
        Passage("", texts.PAIRS, single, folded=folded),
    ]


def _regions(comparison: Comparison) -> Table:
    """Failures of each group inside the rule of each region, mean over its versions."""
    rows = []
    for region in comparison.regions:
        means = []
        for group in comparison.groups:
            failures = sum(region.failures[version] for version in group.versions)
            means.append(mean_text(failures / len(group.versions)))
        rows.append((region.name, region.rule, str(region.tests), *means))
    groups = (group.group for group in comparison.groups)
    return Table(("region", "rule", "tests inside", *groups), tuple(rows), codes=(1,))


def _changes(changes: pd.DataFrame, comparison: Comparison) -> Passage:
    """Changes of the champion, or of all versions if base is the champion.

    Regressions come first: someone must check them before a release.
    """
    base = comparison.versions[0].version
    chosen, of = changes, "another version"
    if comparison.champion != base:
        chosen = changes[changes["version"] == comparison.champion]
        of = f"the champion {comparison.champion}"
    ranked = chosen.assign(rank=chosen["change"] != "regression")
    shown = ranked.sort_values(["rank", "version"], kind="stable").head(CHANGES)
    rows = []
    for _, row in shown.iterrows():
        modes = MODE_NAMES[row["failure_mode_before"]], MODE_NAMES[row["failure_mode_after"]]
        rows.append(
            (
                row["test_id"],
                row["version"],
                row["change"],
                f"{row['adj_ttc_s_before']:.2f} to {row['adj_ttc_s_after']:.2f} s",
                " to ".join(modes),
                f"{row['false_positives_before']} to {row['false_positives_after']}",
            )
        )
    headers = ("test", "version", "change", "adj. TTC", "failure mode", "false positives")
    text = texts.CHANGES.format(
        base=base, of=of, shown=len(shown), chosen=len(chosen), all=len(changes)
    )
    table = Table(headers, tuple(rows), numbers=(3,), codes=(0,))
    return Passage("Fixes and regressions", text, table)
