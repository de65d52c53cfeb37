"""The report's sections on the search, the regions and the training. Every number comes from an artefact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.analysis.frame_criteria import MEANINGS
from pipeline.artefacts.model_card import ModelCard
from pipeline.artefacts.results import FailureRegion, FailureRegions, Measures, StrategyMeasures, WhiteBoxMeasures, WhiteBoxSet
from pipeline.report import texts
from pipeline.report.formats import decimal, over_seeds, percent
from pipeline.report.page import Drawing, Film, Passage, Section, Table

METRICS = {"precision": "precision", "recall": "recall", "ap50": "AP50", "ap50_95": "AP50-95"}


def headline(found: Sequence[FailureRegions]) -> str:
    """The result of a search in words, scenario by scenario."""
    return " ".join(f"{r.label}: {r.failures} of {r.tests} tests fail; failure regions: {len(r.regions)}." for r in found)


def search_section(
    measures: Measures,
    white_box: WhiteBoxMeasures | None,
    labels: Mapping[str, str],
    plots: Sequence[Drawing],
    coverage: Sequence[Drawing],
) -> Section:
    """How well the strategies find failures. labels: scenario -> its label. white_box: None leaves its part out."""
    parts = [_failures_found(measures, labels, plots), _coverage(measures, labels, coverage)]
    if white_box is not None:
        parts.append(_white_box(white_box))
    return Section("Search", (texts.SEARCH.format(confidence=100 * measures.confidence),), tuple(parts))


def _failures_found(measures: Measures, labels: Mapping[str, str], plots: Sequence[Drawing]) -> Passage:
    headers = ("scenario", "strategy", "failures / tests", "failure rate", "F", "C")
    rows = tuple(_search_row(row, labels[row.scenario], measures.baseline) for row in measures.strategies)
    return Passage("Failures found", texts.MEASURES.format(baseline=measures.baseline), Table(headers, rows, numbers=(2, 3)), tuple(plots))


def _search_row(row: StrategyMeasures, label: str, baseline: str) -> tuple[str, ...]:
    seeds = len(row.seeds)
    saved = "baseline" if row.strategy == baseline else over_seeds(row.c_measure, row.c_measure_seeds, seeds, "{:.2f}")
    first = over_seeds(row.f_measure, row.f_measure_seeds, seeds, "{:.0f}")
    return label, row.strategy, f"{row.failures} / {row.tests - row.errors}", percent(row.rate), first, saved


def _coverage(measures: Measures, labels: Mapping[str, str], plots: Sequence[Drawing]) -> Passage:
    headers = ("scenario", "strategy", "pairs in tests", "pairs in failures", f"{measures.k}-projection")
    rows = tuple(
        (
            labels[row.scenario],
            row.strategy,
            *map(percent, (row.pair_coverage_tests, row.pair_coverage_failures, row.projection_coverage)),
        )
        for row in measures.strategies
    )
    return Passage("Coverage of the scenario space", texts.COVERAGE, Table(headers, rows, numbers=(2, 3, 4)), tuple(plots))


def _white_box(measures: WhiteBoxMeasures) -> Passage:
    headers = ("strategy", "images", "active neurons", "sections", "strongly active", "top", "pairs")
    how = texts.WHITE_BOX.format(neurons=measures.neurons, layers=measures.layers, images=measures.training_images)
    return Passage("Coverage of the detector's neurons", how, Table(headers, tuple(map(_white_box_row, measures.sets))))


def _white_box_row(shown: WhiteBoxSet) -> tuple[str, ...]:
    shares = (shown.neuron, shown.multisection, shown.strong, shown.top, shown.pairs)
    return shown.name, str(shown.images), *(f"{100 * share:.1f} %" for share in shares)


def regions_section(found: Sequence[FailureRegions], plots: Mapping[str, Drawing], replays: Mapping[str, Sequence[Film]]) -> Section:
    """Where the searched version fails, scenario by scenario."""
    parts = tuple(_scenario_regions(r, plots, replays.get(r.scenario, ())) for r in found)
    return Section("Failure regions", (texts.REGIONS,), parts)


def _scenario_regions(regions: FailureRegions, plots: Mapping[str, Drawing], replays: Sequence[Film]) -> Passage:
    summary = (
        f"{regions.failures} of {regions.tests} tests fail ({100 * regions.base_rate:.1f} %). Regions: {len(regions.regions)}. "
        f"Failures in no region: {len(regions.unassigned)}. Connected sets of failures (Def. 4.19): {regions.connected}. "
        f"Not solvable with this camera: {len(regions.not_solvable)}."
    )
    headers = ("region", "rule", "failures", "not solvable", "failures inside rule", "share covered", "failure modes", "found by")
    rows = tuple(_region_row(region, set(regions.not_solvable)) for region in regions.regions)
    table = Table(headers, rows, numbers=(4,), codes=(1,)) if rows else None
    drawings = (plots[regions.scenario],) if regions.failures else ()
    text = summary if regions.failures else f"{summary} {texts.NO_FAILURES}"
    return Passage(regions.label, text, table, drawings, tuple(replays))


def _region_row(region: FailureRegion, not_solvable: set[str]) -> tuple[str, ...]:
    return (
        region.name,
        region.rule,
        str(len(region.members)),
        str(len(set(region.members) & not_solvable)),
        f"{region.failures_inside} / {region.support} = {percent(region.precision)}",
        f"{100 * region.recall:.0f} %",
        ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in region.modes if count),
        ", ".join(f"{count} {name}" for name, count in region.strategies.items()),
    )


def data_section(
    filters: Mapping[str, pd.DataFrame], cards: Sequence[ModelCard], border: Sequence[Drawing], plots: Sequence[Drawing]
) -> Section | None:
    """What the versions were trained on and how well they detect on single images; None without filters and cards."""
    parts = [*([_frames(filters, border)] if filters else []), *([_detection(cards, plots)] if cards else [])]
    return Section("Data and training", (), tuple(parts)) if parts else None


def _frames(filters: Mapping[str, pd.DataFrame], border: Sequence[Drawing]) -> Passage:
    reasons = list(dict.fromkeys([*MEANINGS, *(str(r) for table in filters.values() for r in table["reason"].unique())]))
    rows = [
        (MEANINGS.get(reason, reason), *(_kept(table, reason) for table in filters.values()))
        for reason in reasons
        if any((table["reason"] == reason).any() for table in filters.values())
    ]
    rows.append(("all", *(f"{int(table['kept'].sum())} kept of {len(table)}" for table in filters.values())))
    table = Table(("frames", *filters), tuple(rows), numbers=tuple(range(1, len(filters) + 1)))
    return Passage("Frames from the search", texts.FRAMES, table, tuple(border))


def _kept(table: pd.DataFrame, reason: str) -> str:
    rows = table[table["reason"] == reason]
    kept = int(rows["kept"].sum())
    if kept == len(rows):
        return f"{kept} kept"
    return f"{len(rows)} rejected" if kept == 0 else f"{kept} kept, {len(rows) - kept} rejected"


def _detection(cards: Sequence[ModelCard], plots: Sequence[Drawing]) -> Passage:
    headers = ("version", "parent", "parameters", *METRICS.values(), "false positives per image", "weights")
    table = Table(headers, tuple(map(_card_row, cards)), codes=(len(headers) - 1,))
    return Passage("Single-image detection", texts.DETECTION, table, tuple(plots))


def _card_row(card: ModelCard) -> tuple[str, ...]:
    metrics = (*METRICS, "false_positives_an_image")
    numbers = (decimal(card.metrics.get(name)) for name in metrics)
    return card.version, card.parent or "none", f"{card.parameters:,}", *numbers, card.weights_sha256[:12]
