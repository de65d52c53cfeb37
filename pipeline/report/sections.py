"""The report's sections on the search, the regions and the training. Every number comes from an artefact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.analysis.frame_criteria import MEANINGS
from pipeline.analysis.pair_shares import PairShare
from pipeline.analysis.region_sentence import subject
from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.artefacts.model_card import ModelCard
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.search_results import BaseRate, Measures, StrategyMeasures
from pipeline.artefacts.white_box_results import WhiteBoxMeasures, WhiteBoxSet
from pipeline.core.names import count_of
from pipeline.report import texts
from pipeline.report.failure_tables import (
    CAUSES,
    NONE,
    base_rate_sentence,
    braking_in_search,
    cause_cells,
    rate_text,
)
from pipeline.report.formats import censored, decimal, mean_text, percent, share
from pipeline.report.page import Card, Drawing, Passage, Section, Table

QUARTERS = (0.25, 0.5, 0.75, 1)
METRICS = {"precision": "precision", "recall": "recall", "ap50": "AP50", "ap50_95": "AP50-95"}


def headline(found: Sequence[FailureRegions], rates: Sequence[BaseRate]) -> str:
    """The result of a search in words, scenario by scenario, and the base failure rates."""
    labels = {regions.scenario: regions.label for regions in found}
    return " ".join([*map(_scenario_headline, found), base_rate_sentence(rates, labels)]).strip()


def _scenario_headline(regions: FailureRegions) -> str:
    if regions.failures == regions.tests > 0:
        return f"{regions.label}: every test fails ({regions.tests} of {regions.tests})."
    return f"{regions.label}: {regions.failures} of {regions.tests} tests fail; failure regions: {len(regions.regions)}."


def largest_regions(found: Sequence[FailureRegions]) -> list[str]:
    """`Largest failure region of the search: children at most 1.25 m tall in F1 (19 failures).`; nothing without a region."""
    named = []
    for regions, largest in ((one, one.regions[0]) for one in found if one.regions):
        who = subject(largest.conditions)
        named.append(
            f"{who[0].lower()}{who[1:]} in {regions.label} ({count_of(len(largest.members), 'failure')})"
        )
    return (
        [
            f"Largest failure {'region' if len(named) == 1 else 'regions'} of the search: {'; '.join(named)}."
        ]
        if named
        else []
    )


def search_section(
    measures: Measures,
    white_box: WhiteBoxMeasures | None,
    labels: Mapping[str, str],
    plots: Sequence[Drawing],
    coverage: Sequence[Drawing],
    pairs: Mapping[str, Sequence[PairShare]],
) -> Section:
    """How well the strategies find failures. labels: scenario -> its label. white_box: None leaves its part out. pairs: by scenario."""
    found = [
        _failures_found(measures, labels, plots),
        _theta(measures, labels),
        _causes(measures, labels),
        *_braking(measures, labels),
    ]
    parts = [*found, _coverage(measures, labels, coverage), _pairs(pairs, labels)]
    if white_box is not None:
        parts.append(_white_box(white_box))
    return Section(
        "Search", (texts.SEARCH.format(confidence=100 * measures.confidence),), tuple(parts)
    )


def _failures_found(
    measures: Measures, labels: Mapping[str, str], plots: Sequence[Drawing]
) -> Passage:
    headers = (
        "scenario",
        "strategy",
        "failures / tests",
        "failure rate",
        "base failure rate",
        "F",
        "C",
    )
    bases = {rate.scenario: rate_text(rate) for rate in measures.base_rates}
    rows = tuple(
        _search_row(row, labels[row.scenario], bases.get(row.scenario, NONE))
        for row in measures.strategies
    )
    how = texts.MEASURES.format(baseline=measures.baseline)
    return Passage("Failures found", how, Table(headers, rows, numbers=(2, 3, 4)), tuple(plots))


def _search_row(row: StrategyMeasures, label: str, base: str) -> tuple[str, ...]:
    seeds = len(row.seeds)
    saved = (
        "baseline"
        if row.c_measure is None
        else censored(row.c_measure, row.c_measure_censored, seeds, "{:.2f}", "<")
    )
    first = censored(row.f_measure, row.f_measure_censored, seeds, "{:.0f}", ">")
    return (
        label,
        row.strategy,
        f"{row.failures} / {row.tests - row.errors}",
        percent(row.rate),
        base,
        first,
        saved,
    )


def _theta(measures: Measures, labels: Mapping[str, str]) -> Passage:
    """The curves of failures found in numbers."""
    rows = []
    for row in measures.strategies:
        curves = [
            c.theta
            for c in measures.campaigns
            if (c.scenario, c.strategy) == (row.scenario, row.strategy)
        ]
        length = min(map(len, curves))
        found = (
            sum(curve[max(0, round(part * length) - 1)] for curve in curves) / len(curves)
            for part in QUARTERS
            if length
        )
        rows.append((labels[row.scenario], row.strategy, str(length), *map(mean_text, found)))
    headers = (
        "scenario",
        "strategy",
        "tests",
        *(f"after {100 * part:.0f} % of them" for part in QUARTERS),
    )
    return Passage(
        table=Table(headers, tuple(rows)),
        folded="Failures found after each quarter of the tests, mean over seeds",
    )


def _causes(measures: Measures, labels: Mapping[str, str]) -> Passage:
    rows = tuple(
        (labels[row.scenario], row.strategy, str(row.failures), *cause_cells(row.causes))
        for row in measures.strategies
    )
    return Passage(
        "Failures by cause",
        texts.CAUSES,
        Table(("scenario", "strategy", "failures", *CAUSES.values()), rows),
    )


def _braking(measures: Measures, labels: Mapping[str, str]) -> list[Passage]:
    """Nothing if all scenarios ask to brake."""
    found = braking_in_search(measures, labels)
    return (
        [
            Passage(
                "Unnecessary braking",
                texts.BRAKING,
                Table(found[0], tuple(found[1:]), numbers=(6, 7)),
            )
        ]
        if found
        else []
    )


def _coverage(measures: Measures, labels: Mapping[str, str], plots: Sequence[Drawing]) -> Passage:
    headers = (
        "scenario",
        "strategy",
        "pairs in tests",
        "pairs in failures",
        "pairs tested three times",
    )
    rows = tuple(
        (
            labels[row.scenario],
            row.strategy,
            *map(
                percent,
                (row.pair_coverage_tests, row.pair_coverage_failures, row.projection_coverage),
            ),
        )
        for row in measures.strategies
    )
    return Passage(
        "Coverage of the scenario space",
        texts.COVERAGE,
        Table(headers, rows, numbers=(2, 3, 4)),
        tuple(plots),
    )


def _pairs(pairs: Mapping[str, Sequence[PairShare]], labels: Mapping[str, str]) -> Passage:
    """The heat maps in numbers."""
    rows = tuple(
        (
            labels[scenario],
            one.first,
            one.second,
            str(one.feasible),
            *(_of(part, one.feasible) for part in (one.tests, one.failures)),
        )
        for scenario, shares in pairs.items()
        for one in shares
    )
    headers = (
        "scenario",
        "variable",
        "and variable",
        "pairs of categories",
        "in tests",
        "in failures",
    )
    return Passage(
        table=Table(headers, rows, numbers=(4, 5)),
        folded=f"Covered pairs of categories in numbers ({len(rows)})",
    )


def _of(part: int, whole: int) -> str:
    return f"{part} = {share(part / whole)}"


def _white_box(measures: WhiteBoxMeasures) -> Passage:
    headers = (
        "strategy",
        "images",
        "active neurons",
        "sections",
        "strongly active",
        "top",
        "pairs",
    )
    how = texts.WHITE_BOX.format(
        neurons=f"{measures.neurons:,}", layers=measures.layers, images=measures.training_images
    )
    return Passage(
        "Coverage of the detector's neurons",
        how,
        Table(headers, tuple(map(_white_box_row, measures.sets)), numbers=(2, 3, 4, 5, 6)),
    )


def _white_box_row(shown: WhiteBoxSet) -> tuple[str, ...]:
    shares = (shown.neuron, shown.multisection, shown.strong, shown.top, shown.pairs)
    return shown.name, str(shown.images), *map(share, shares)


def regions_section(
    found: Sequence[FailureRegions],
    rates: Sequence[BaseRate],
    plots: Mapping[str, Drawing],
    cards: Mapping[str, Sequence[Card]],
) -> Section:
    """Where the searched version fails, scenario by scenario. rates: its base failure rates. cards: by scenario."""
    bases = {
        rate.scenario: f" Base failure rate: {rate_text(rate)}, {rate.strategy} tests."
        for rate in rates
    }
    parts = tuple(
        _scenario_regions(r, bases.get(r.scenario, ""), plots, cards[r.scenario]) for r in found
    )
    return Section("Failure regions", (texts.REGIONS,), parts)


def _scenario_regions(
    regions: FailureRegions, base: str, plots: Mapping[str, Drawing], cards: Sequence[Card]
) -> Passage:
    every = "Every test fails. " if regions.failures == regions.tests > 0 else ""
    summary = (
        f"{every}{regions.failures} of {regions.tests} tests fail ({100 * regions.failure_rate:.1f} %). Regions: {len(regions.regions)}. "
        f"Isolated failures, in no region: {len(regions.isolated)}. Connected sets of failures (Def. 4.19): {regions.connected}. "
        f"Not solvable with this camera: {len(regions.not_solvable)}.{base}"
    )
    text = summary if regions.failures else f"{summary} {texts.NO_FAILURES}"
    return Passage(
        regions.label,
        text,
        plots=(plots[regions.scenario],) if regions.failures else (),
        cards=tuple(cards),
    )


def data_section(
    filters: Mapping[str, pd.DataFrame],
    cards: Sequence[ModelCard],
    border: Sequence[Drawing],
    plots: Sequence[Drawing],
) -> Section | None:
    """What the versions were trained on and how well they detect on single images; None without filters and cards."""
    parts = [
        *([_frames(filters, border)] if filters else []),
        *([_detection(cards, plots)] if cards else []),
    ]
    return Section("Data and training", (), tuple(parts)) if parts else None


def _frames(filters: Mapping[str, pd.DataFrame], border: Sequence[Drawing]) -> Passage:
    reasons = list(
        dict.fromkeys(
            [*MEANINGS, *(str(r) for table in filters.values() for r in table["reason"].unique())]
        )
    )
    rows = [
        (MEANINGS.get(reason, reason), *(_kept(table, reason) for table in filters.values()))
        for reason in reasons
        if any((table["reason"] == reason).any() for table in filters.values())
    ]
    rows.append(
        ("all", *(f"{int(table['kept'].sum())} kept of {len(table)}" for table in filters.values()))
    )
    table = Table(("frames", *filters), tuple(rows), numbers=tuple(range(1, len(filters) + 1)))
    return Passage("Frames from the search", texts.FRAMES, table, tuple(border))


def _kept(table: pd.DataFrame, reason: str) -> str:
    rows = table[table["reason"] == reason]
    kept = int(rows["kept"].sum())
    if rows.empty:
        return NONE
    if kept == len(rows):
        return f"{kept} kept"
    return f"{len(rows)} rejected" if kept == 0 else f"{kept} kept, {len(rows) - kept} rejected"


def calibration_section(
    calibrations: Sequence[DetectorCalibration], plots: Sequence[Drawing]
) -> Section:
    """How the confidences of detectors under test are calibrated."""
    headers = (
        "detector",
        "slope",
        "offset",
        "error before",
        "error after",
        "detections",
        "correct",
    )
    table = Table(headers, tuple(map(_calibration_row, calibrations)))
    notes = tuple(
        texts.NOT_CALIBRATED.format(version=found.version)
        for found in calibrations
        if not found.fitted
    )
    how = texts.CALIBRATION.format(images=calibrations[0].images)
    return Section("Calibration", (how,), (Passage(table=table, plots=tuple(plots), notes=notes),))


def _calibration_row(found: DetectorCalibration) -> tuple[str, ...]:
    numbers = (found.slope, found.offset, found.errors["uncalibrated"], found.errors["calibrated"])
    return found.version, *map(decimal, numbers), str(found.detections), str(found.right)


def _detection(cards: Sequence[ModelCard], plots: Sequence[Drawing]) -> Passage:
    headers = (
        "version",
        "parent",
        "parameters",
        *METRICS.values(),
        "false positives per image",
        "weights",
    )
    table = Table(headers, tuple(map(_card_row, cards)), codes=(len(headers) - 1,))
    return Passage("Single-image detection", texts.DETECTION, table, tuple(plots))


def _card_row(card: ModelCard) -> tuple[str, ...]:
    metrics = (*METRICS, "false_positives_an_image")
    numbers = (decimal(card.metrics.get(name)) for name in metrics)
    return (
        card.version,
        card.parent or "none",
        f"{card.parameters:,}",
        *numbers,
        card.weights_sha256[:12],
    )
