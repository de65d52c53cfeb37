"""The report's headline and its verdict section: the model versions compared. Every number comes from an artefact."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from pipeline.artefacts.comparison_results import Comparison, LimitResult, VersionResult
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
    """The result in words: failures of base, then the other versions by verdict; versions that differ by their seed alone are one."""
    base = comparison.groups[0]
    *most, last = comparison.scenarios.values()
    where = f"scenarios {', '.join(most)} and {last}" if most else f"scenario {last}"
    parts = [
        f"On the held-out {where}, {base.group} fails {mean_text(base.failures.value)} of {base.tests} tests."
    ]
    parts += [base_rate_sentence(comparison.base_rates), *_against_base(comparison)]
    parts += _at_second_iou(comparison)
    if comparison.seeds > 1:
        parts.append(
            f"Failures of retrained versions are means over {comparison.seeds} seeds of retraining."
        )
    return " ".join(filter(None, parts))


def _against_base(comparison: Comparison) -> list[str]:
    """A sentence for each verdict on groups that some group has."""
    failures = {
        group.group: f"{group.group} {mean_text(group.failures.value)}"
        for group in comparison.groups
    }
    base = comparison.groups[0].group
    pairs = [pair for pair in comparison.group_pairs if pair.against == base]
    shown = [pair for pair in pairs if pair.shown(comparison.alpha)]
    by_verdict = {
        f"Fewer failures than {base}": [pair for pair in shown if pair.difference.value < 0],
        f"More failures than {base}": [pair for pair in shown if pair.difference.value > 0],
        f"Not shown to differ from {base}": [pair for pair in pairs if pair not in shown],
    }
    return [
        f"{verdict}: {', '.join(failures[pair.group] for pair in chosen)}."
        for verdict, chosen in by_verdict.items()
        if chosen
    ]


def _at_second_iou(comparison: Comparison) -> list[str]:
    """Whether what is shown against the base is shown at the second IoU, too; nothing if nothing is shown or there is no second IoU."""
    second, base = comparison.second, comparison.groups[0].group
    if second is None:
        return []
    both = list(zip(comparison.group_pairs, second.group_pairs, strict=True))
    shown = [
        (first, again)
        for first, again in both
        if first.against == base and first.shown(comparison.alpha)
    ]
    if not shown:
        return []
    lost = [first.group for first, again in shown if not holds(first, again, comparison.alpha)]
    found = (
        f"not shown at {second.iou:g} for {', '.join(lost)}"
        if lost
        else f"shown at {second.iou:g}, too"
    )
    return [f"The differences shown at an IoU of {second.first:g} are {found}."]


def verdict_section(
    comparison: Comparison,
    changes: pd.DataFrame,
    plots: Sequence[Drawing],
    rounds: Passage | None,
    stills: Sequence[BeforeAfter],
    replays: Sequence[Film],
) -> Section:
    """The comparison of the model versions. changes: of changes.csv, with `test_id`. rounds: `rounds_part`, or None. stills: of fixes."""
    base = comparison.versions[0].version
    parts = [
        Passage(table=Table(HEADERS, tuple(verdict_rows(comparison)), numbers=(1, 2, 3))),
        *(
            [Passage("More fixes, before and after", texts.STILLS, stills=tuple(stills))]
            if stills
            else []
        ),
        *_planted(comparison),
        Passage("What the verdict rests on", notes=tuple(verdict_sentences(comparison))),
        *_limits(comparison),
        Passage(
            "By scenario",
            texts.TABLE,
            Table(group_headers(comparison), tuple(group_rows(comparison))),
        ),
        *([] if rounds is None else [rounds]),
        _modes(comparison.versions, plots),
        _causes(comparison.versions),
        *_braking(comparison),
        *_second_iou(comparison),
        *_every_pair(comparison),
    ]
    if comparison.regions:
        parts.append(
            Passage(
                f"Failure regions of {base}",
                texts.HELD_OUT_REGIONS.format(base=base),
                _regions(comparison),
            )
        )
    if len(changes):
        parts.append(_changes(changes, comparison))
    if replays:
        parts.append(Passage("Replays of a regression", texts.PAIR, replays=tuple(replays)))
    return Section("Verdict", _introduction(comparison), tuple(parts))


def _planted(comparison: Comparison) -> list[Passage]:
    header, *rows = planted_rows(comparison) or [()]
    return (
        [Passage("Planted blind spots", texts.PLANTED, Table(header, tuple(rows)))] if rows else []
    )


def _introduction(comparison: Comparison) -> tuple[str, ...]:
    with_control = any(group.group.partition("-")[0] == "control" for group in comparison.groups)
    return (f"{texts.VERDICT} {texts.CONTROL}" if with_control else texts.VERDICT,)


def rounds_part(searched: pd.DataFrame, plots: Sequence[Drawing]) -> Passage:
    """Failures after each round, and what its searches found. searched: rows of all campaigns that versions learn from."""
    valid, rows = searched[is_valid(searched)], []
    for (version, strategy), tests in valid.groupby(["version", "strategy"], sort=False):
        failures = int(tests["failure"].sum())
        rows.append(
            (
                str(version),
                str(strategy),
                f"{failures} / {len(tests)}",
                share(failures / len(tests)),
            )
        )
    table = Table(
        ("searched version", "strategy", "failures / tests", "failure rate"),
        tuple(rows),
        numbers=(2, 3),
    )
    return Passage("Round by round", texts.ROUNDS, table, tuple(plots))


def _modes(versions: Sequence[VersionResult], plots: Sequence[Drawing]) -> Passage:
    headers = (
        "version",
        "failures",
        "contact",
        "late",
        "by TTC alone",
        "false positives alone",
        "unnecessary braking",
        "failure rate",
        "errors",
    )
    return Passage(
        "Failure modes",
        texts.MODES,
        Table(headers, tuple(map(_modes_row, versions)), numbers=(7,)),
        tuple(plots),
    )


def _modes_row(result: VersionResult) -> tuple[str, ...]:
    modes = result.modes
    counts = (
        modes.total,
        modes.contact,
        modes.late,
        modes.by_ttc,
        modes.false_positives,
        modes.false_activation,
    )
    return result.version, *(str(count) for count in counts), share(result.rate), str(result.errors)


def _causes(versions: Sequence[VersionResult]) -> Passage:
    rows = tuple(
        (result.version, str(result.failures), *cause_cells(result.causes)) for result in versions
    )
    return Passage(
        "Failures by cause", texts.CAUSES, Table(("version", "failures", *CAUSES.values()), rows)
    )


def _braking(comparison: Comparison) -> list[Passage]:
    """Nothing if all held-out scenarios ask to brake."""
    found = braking_held_out(comparison)
    return (
        [
            Passage(
                "Unnecessary braking",
                texts.BRAKING,
                Table(found[0], tuple(found[1:]), numbers=(5, 6)),
            )
        ]
        if found
        else []
    )


def _second_iou(comparison: Comparison) -> list[Passage]:
    """Failures of the groups at both IoUs; nothing without a second one."""
    second = comparison.second
    if second is None:
        return []
    base, pairs = (
        comparison.groups[0].group,
        {(pair.group, pair.against): pair for pair in second.group_pairs},
    )
    rows = []
    for first, again in zip(comparison.groups, second.groups, strict=True):
        pair = pairs.get((again.group, base))
        change = (signed(pair.difference), f"{pair.p_value:.2g}") if pair else ("", "")
        rows.append((first.group, counted(first.failures), counted(again.failures), *change))
    headers = (
        "version",
        f"failures at {second.first:g}",
        f"failures at {second.iou:g}",
        f"difference from {base} at {second.iou:g}",
        "p",
    )
    text = texts.SECOND_IOU.format(first=second.first, second=second.iou)
    return [Passage("At another IoU", text, Table(headers, tuple(rows), numbers=(3,)))]


def _limits(comparison: Comparison) -> list[Passage]:
    """The limits that the gate compares with the margin, folded away; nothing if only the base was compared."""
    judged = [result for result in comparison.versions if result.limits]
    if not judged:
        return []
    rows = tuple(
        _limits_row(limits) for limits in zip(*(result.limits for result in judged), strict=True)
    )
    table = Table(
        ("scenario or group", "tests", *(result.version for result in judged)),
        rows,
        numbers=tuple(range(2, len(judged) + 2)),
    )
    text = texts.LIMITS.format(
        base=comparison.versions[0].version,
        confidence=100 * comparison.confidence,
        margin=100 * comparison.margin,
    )
    return [
        Passage(
            "",
            text,
            table,
            folded=f"The gate: how far the failure rate may rise, by scenario and group ({len(rows)})",
        )
    ]


def _limits_row(limits: Sequence[LimitResult]) -> tuple[str, ...]:
    """One scenario or group: its tests and the limit of each version. Versions with errors there have fewer tests."""
    first, tests = limits[0], sorted({limit.tests for limit in limits})
    name = first.name if first.measure == "failures" else f"{first.name}, {first.measure}"
    return name, "–".join(map(str, dict.fromkeys((tests[0], tests[-1])))), *map(_limit, limits)


def _limit(limit: LimitResult) -> str:
    if limit.judgement == "too small to judge":
        return "too small"
    return (
        f"{share(limit.limit)} (above)"
        if limit.judgement == "above the margin"
        else share(limit.limit)
    )


def _every_pair(comparison: Comparison) -> list[Passage]:
    """All against all; with several seeds the groups, and the single versions folded away."""
    if len(comparison.groups) == len(comparison.versions):
        return [Passage("All pairs of versions", texts.PAIRS, _pairs(comparison))]
    rows = tuple(
        (pair.group, pair.against, signed(pair.difference), f"{pair.p_value:.2g}")
        for pair in comparison.group_pairs
    )
    groups = Table(("versions", "against", "difference in failures", "p"), rows, numbers=(2,))
    return [
        Passage(
            "All pairs of versions, seeds together",
            texts.GROUP_PAIRS.format(alpha=comparison.alpha),
            groups,
        ),
        Passage(
            "",
            texts.PAIRS,
            _pairs(comparison),
            folded=f"All pairs of single versions ({len(comparison.pairs)})",
        ),
    ]


def _pairs(comparison: Comparison) -> Table:
    rows = tuple(
        (
            pair.version,
            pair.against,
            str(len(pair.fixes)),
            str(len(pair.regressions)),
            f"{pair.p_value:.2g}",
        )
        for pair in comparison.pairs
    )
    return Table(("version", "against", "fixes", "regressions", "p"), rows)


def _regions(comparison: Comparison) -> Table:
    groups = comparison.groups
    rows = tuple(
        (
            r.name,
            r.rule,
            str(r.tests),
            *(
                mean_text(sum(r.failures[name] for name in g.versions) / len(g.versions))
                for g in groups
            ),
        )
        for r in comparison.regions
    )
    return Table(
        ("region", "rule", "tests inside", *(group.group for group in groups)), rows, codes=(1,)
    )


def _changes(changes: pd.DataFrame, comparison: Comparison) -> Passage:
    """Of the champion, if it is a retrained version: its regressions come first, because someone must check them before a release."""
    released = comparison.champion != comparison.versions[0].version
    chosen = changes[changes["version"] == comparison.champion] if released else changes
    ranked = chosen.assign(rank=chosen["change"] != "regression")
    shown = ranked.sort_values(["rank", "version"], kind="stable").head(CHANGES)
    table = Table(
        ("test", "version", "change", "adj. TTC", "failure mode", "false positives"),
        tuple(_change_row(row) for _, row in shown.iterrows()),
        numbers=(3,),
        codes=(0,),
    )
    of = f"the champion {comparison.champion}" if released else "another version"
    text = texts.CHANGES.format(
        base=comparison.versions[0].version,
        of=of,
        shown=len(shown),
        chosen=len(chosen),
        all=len(changes),
    )
    return Passage("Fixes and regressions", text, table)


def _change_row(row: pd.Series) -> tuple[str, ...]:
    return (
        row["test_id"],
        row["version"],
        row["change"],
        f"{row['adj_ttc_s_before']:.2f} to {row['adj_ttc_s_after']:.2f} s",
        f"{MODE_NAMES[row['failure_mode_before']]} to {MODE_NAMES[row['failure_mode_after']]}",
        f"{row['false_positives_before']} to {row['false_positives_after']}",
    )
