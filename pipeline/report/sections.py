"""What the report says: its sections, built from the study's results. Every number comes from an artefact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.analysis.frame_criteria import MEANINGS
from pipeline.artefacts.comparison_results import Comparison, VersionResult
from pipeline.artefacts.model_card import ModelCard
from pipeline.artefacts.results import Estimate, FailureRegions, Measures, WhiteBoxMeasures
from pipeline.core.statistics import wilson_interval
from pipeline.report import texts
from pipeline.report.page import Drawing, Film, Part, Section, Table
from pipeline.report.verdict import HEADERS, group_headers, group_rows, mean_text, verdict_rows, verdict_sentences

CHANGES = 20
"""Rows shown of changes.csv."""
METRICS = {"precision": "precision", "recall": "recall", "ap50": "AP50", "ap50_95": "AP50-95"}


def headline(comparison: Comparison) -> str:
    """The result in words: what base fails, what the others do about it; versions that differ by their seed alone are one."""
    base = comparison.groups[0]
    failures = {group.group: f"{group.group} ({mean_text(group.failures.value)})" for group in comparison.groups}
    *most, last = comparison.scenarios.values()
    where = f"scenarios {', '.join(most)} and {last}" if most else f"scenario {last}"
    tests = comparison.versions[0].tests
    parts = [f"On {tests} tests of the held-out {where} the {base.group} detector fails {mean_text(base.failures.value)}."]
    pairs = [pair for pair in comparison.group_pairs if pair.against == base.group]
    shown = [pair for pair in pairs if pair.shown(comparison.alpha)]
    for phrase, chosen in (
        ("Fewer failures are shown for", [pair for pair in shown if pair.difference.value < 0]),
        ("More failures are shown for", [pair for pair in shown if pair.difference.value > 0]),
        ("No difference is shown for", [pair for pair in pairs if pair not in shown]),
    ):
        if chosen:
            parts.append(f"{phrase} {', '.join(failures[pair.group] for pair in chosen)}.")
    seeds = max(len(group.versions) for group in comparison.groups)
    if seeds > 1:
        parts.append(f"Numbers in brackets are means over {seeds} seeds of retraining.")
    return " ".join(parts)


def verdict_section(
    comparison: Comparison,
    changes: pd.DataFrame,
    plots: Sequence[Drawing],
    rounds: Part | None,
    replays: Sequence[Film],
) -> Section:
    """The comparison of the model versions. changes: rows of changes.csv. rounds: `rounds_part`, where there are several."""
    modes = Table(
        ("version", "fail", "contact", "too late", "by TTC alone", "false positives alone", "failure rate", "broken"),
        tuple(_modes_row(result) for result in comparison.versions),
        numbers=(6,),
    )
    parts = [
        Part(table=Table(HEADERS, tuple(verdict_rows(comparison)), numbers=(1, 2, 3)), notes=tuple(verdict_sentences(comparison))),
        Part("By scenario", texts.TABLE, Table(group_headers(comparison), tuple(group_rows(comparison)))),
        Part("How they fail", texts.MODES, modes, tuple(plots)),
        *_every_pair(comparison),
    ]
    if rounds is not None:
        parts.insert(2, rounds)
    if comparison.regions:
        parts.append(Part("The base's failure regions", texts.HELD_OUT_REGIONS, _regions(comparison)))
    if len(changes):
        parts.append(_changes(changes, comparison))
    if replays:
        parts.append(Part("Tests that changed", texts.PAIR, replays=tuple(replays)))
    return Section("Verdict", (texts.VERDICT,), tuple(parts))


def rounds_part(searched: pd.DataFrame, confidence: float, plots: Sequence[Drawing]) -> Part:
    """What became of the failures, and what each round's search found. searched: rows of all campaigns that versions learn from."""
    valid, rows = searched[searched["status"] == "ok"], []
    for (version, strategy), tests in valid.groupby(["version", "strategy"], sort=False):
        failures = int(tests["failure"].sum())
        low, high = wilson_interval(failures, len(tests), confidence)
        rate = percent(Estimate(value=failures / len(tests), low=low, high=high))
        rows.append((str(version), str(strategy), f"{failures} / {len(tests)}", rate))
    table = Table(("searched version", "strategy", "failures / tests", "failure rate"), tuple(rows), numbers=(2, 3))
    return Part("Round by round", texts.ROUNDS, table, tuple(plots))


def _every_pair(comparison: Comparison) -> list[Part]:
    """All against all; with several seeds the groups, and the single versions folded away."""
    if len(comparison.groups) == len(comparison.versions):
        return [Part("Every version against every other", texts.PAIRS, _pairs(comparison))]
    rows = tuple((pair.group, pair.against, _signed(pair.difference), f"{pair.p_value:.2g}") for pair in comparison.group_pairs)
    groups = Table(("versions", "against", "failures more or less", "p"), rows, numbers=(2,))
    return [
        Part("Every kind of version against every other", texts.GROUP_PAIRS, groups),
        Part("", texts.PAIRS, _pairs(comparison), folded=f"Every single version against every other ({len(comparison.pairs)} pairs)"),
    ]


def _signed(mean: Estimate) -> str:
    return f"{mean.value:+.1f} ({mean.low:+.1f} to {mean.high:+.1f})"


def _pairs(comparison: Comparison) -> Table:
    rows = tuple(
        (pair.version, pair.against, str(len(pair.fixes)), str(len(pair.regressions)), f"{pair.p_value:.2g}") for pair in comparison.pairs
    )
    return Table(("version", "against", "only the second fails", "only the first fails", "p"), rows)


def _regions(comparison: Comparison) -> Table:
    groups = comparison.groups
    rows = tuple(
        (r.name, r.rule, str(r.tests), *(mean_text(sum(r.failures[name] for name in g.versions) / len(g.versions)) for g in groups))
        for r in comparison.regions
    )
    return Table(("region", "rule", "tests inside", *(group.group for group in groups)), rows, codes=(1,))


def _changes(changes: pd.DataFrame, comparison: Comparison) -> Part:
    """Of the version that would be released, where there is one: its regressions first, which a person must look at before."""
    released = comparison.champion != comparison.versions[0].version
    chosen = changes[changes["version"] == comparison.champion] if released else changes
    ordered = chosen.sort_values(["change", "version"], ascending=[False, True], kind="stable").head(CHANGES)
    rows = tuple(
        (
            f"{row['scenario']}-{row['index']:05d}",
            row["version"],
            row["change"],
            f"{row['adj_ttc_s_before']:.2f} to {row['adj_ttc_s_after']:.2f} s",
            f"{row['failure_mode_before']} to {row['failure_mode_after']}".replace("_", " "),
            f"{row['false_positives_before']} to {row['false_positives_after']}",
        )
        for row in ordered.to_dict("records")
    )
    table = Table(("test", "version", "change", "adj. TTC", "failure mode", "false positives"), rows, numbers=(3,))
    of = f"the champion {comparison.champion}" if released else "a retrained version"
    return Part("Fixes and regressions", texts.CHANGES.format(of=of, shown=len(ordered), all=len(changes)), table)


def search_section(
    measures: Measures, white_box: WhiteBoxMeasures, labels: Mapping[str, str], plots: Sequence[Drawing], coverage: Sequence[Drawing]
) -> Section:
    """How well the test strategies find failures of the base version."""
    intro = texts.SEARCH.format(confidence=100 * measures.confidence)
    headers: tuple[str, ...] = ("scenario", "strategy", "failures / tests", "failure rate", "F", "C")
    rows: tuple[tuple[str, ...], ...] = tuple(
        (
            labels[row.scenario],
            row.strategy,
            f"{row.failures} / {row.tests - row.errors}",
            percent(row.rate),
            _seeds(row.f_measure, row.f_measure_seeds, len(row.seeds), "{:.0f}"),
            "baseline" if row.strategy == measures.baseline else _seeds(row.c_measure, row.c_measure_seeds, len(row.seeds), "{:.2f}"),
        )
        for row in measures.strategies
    )
    found = Part("Failures found", texts.MEASURES.format(baseline=measures.baseline), Table(headers, rows, numbers=(2, 3)), tuple(plots))
    headers = ("scenario", "strategy", "pairs in tests", "pairs in failures", f"{measures.k}-projection")
    rows = tuple(
        (
            labels[row.scenario],
            row.strategy,
            percent(row.pair_coverage_tests),
            percent(row.pair_coverage_failures),
            percent(row.projection_coverage),
        )
        for row in measures.strategies
    )
    covered = Part("Coverage of the scenario space", texts.COVERAGE, Table(headers, rows, numbers=(2, 3, 4)), tuple(coverage))
    headers = (
        "images",
        "number",
        "active neurons",
        "sections of training ranges",
        "strongly active",
        "among their layer's top",
        "pairs active together",
    )
    rows = tuple(
        (
            shown.name,
            str(shown.images),
            *(f"{100 * share:.1f} %" for share in (shown.neuron, shown.multisection, shown.strong, shown.top, shown.pairs)),
        )
        for shown in white_box.sets
    )
    how = texts.WHITE_BOX.format(neurons=white_box.neurons, layers=white_box.layers, images=white_box.training_images)
    inside = Part("Coverage of the detector itself", how, Table(headers, rows))
    return Section("Search", (intro,), (found, covered, inside))


def regions_section(found: Sequence[FailureRegions], plots: Mapping[str, Drawing], replays: Mapping[str, Sequence[Film]]) -> Section:
    """Where the base version fails, scenario by scenario."""
    parts = []
    for regions in found:
        summary = (
            f"{regions.failures} of {regions.tests} tests fail ({100 * regions.base_rate:.1f} %); regions: {len(regions.regions)}, "
            f"failures in none of them: {len(regions.unassigned)}. Connected sets of failures (Def. 4.19): {regions.connected}. "
            f"Not solvable by this camera: {len(regions.not_solvable)}."
        )
        headers = ("region", "rule", "failures", "not solvable", "fail inside rule", "covers", "how", "found by")
        rows = tuple(
            (
                region.name,
                region.rule,
                str(len(region.members)),
                str(len(set(region.members) & set(regions.not_solvable))),
                f"{region.failures_inside} / {region.support} = {percent(region.precision)}",
                f"{100 * region.recall:.0f} %",
                ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in region.modes if count),
                ", ".join(f"{count} {name}" for name, count in region.strategies.items()),
            )
            for region in regions.regions
        )
        table = Table(headers, rows, numbers=(4,), codes=(1,)) if rows else None
        drawings = (plots[regions.scenario],) if regions.failures else ()
        text = summary if regions.failures else f"{summary} {texts.NO_FAILURES}"
        parts.append(Part(regions.label, text, table, drawings, tuple(replays.get(regions.scenario, ()))))
    return Section("Failure regions", (texts.REGIONS,), tuple(parts))


def data_section(
    filters: Mapping[str, pd.DataFrame], cards: Sequence[ModelCard], border: Sequence[Drawing], plots: Sequence[Drawing]
) -> Section:
    """What the versions were trained on and how well they detect in single images."""
    names = list(filters)
    reasons = list(dict.fromkeys([*MEANINGS, *(str(r) for table in filters.values() for r in table["reason"].unique())]))
    rows = [
        (MEANINGS.get(reason, reason), *(_kept(filters[name], reason) for name in names))
        for reason in reasons
        if any((filters[name]["reason"] == reason).any() for name in names)
    ]
    rows.append(("all", *(f"{int(filters[name]['kept'].sum())} kept of {len(filters[name])}" for name in names)))
    filtered = Part(
        "Frames from the search",
        texts.FRAMES,
        Table(("frames", *names), tuple(rows), numbers=tuple(range(1, len(names) + 1))),
        tuple(border),
    )
    headers = ("version", "parent", "parameters", *METRICS.values(), "false positives an image", "weights")
    cells = tuple(
        (
            card.version,
            card.parent or "none",
            f"{card.parameters:,}",
            *(_number(card.metrics.get(name)) for name in METRICS),
            _number(card.metrics.get("false_positives_an_image")),
            card.weights_sha256[:12],
        )
        for card in cards
    )
    versions = Part("Single-image detection", texts.DETECTION, Table(headers, cells, codes=(len(headers) - 1,)), tuple(plots))
    return Section("Data and training", (), (filtered, versions))


def percent(estimate: Estimate) -> str:
    """`12.5 % (8.0 to 18.9)`."""
    value = f"{100 * estimate.value:.1f} %"
    return value if estimate.low == estimate.high else f"{value} ({100 * estimate.low:.1f} to {100 * estimate.high:.1f})"


def _modes_row(result: VersionResult) -> tuple[str, ...]:
    modes = result.modes
    counts = (modes.total, modes.contact, modes.late, modes.by_ttc, modes.false_positives)
    return result.version, *(str(count) for count in counts), percent(result.rate), str(result.errors)


def _seeds(estimate: Estimate | None, having: int, seeds: int, form: str) -> str:
    """The mean over the seeds that have a value, and how many do where not all."""
    if estimate is None:
        return "n/a"
    text = form.format(estimate.value)
    if estimate.low != estimate.high:
        text += f" ({form.format(estimate.low)} to {form.format(estimate.high)})"
    return text if having == seeds else f"{text} in {having} of {seeds} seeds"


def _kept(table: pd.DataFrame, reason: str) -> str:
    rows = table[table["reason"] == reason]
    kept = int(rows["kept"].sum())
    if kept == len(rows):
        return f"{kept} kept"
    return f"{len(rows)} rejected" if kept == 0 else f"{kept} kept, {len(rows) - kept} rejected"


def _number(value: float | None) -> str:
    return "n/a" if value is None else f"{value:.3f}"
