"""The report's sections on the search, the regions and the training, from the artefacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.analysis.frame_criteria import MEANINGS
from pipeline.analysis.pair_shares import PairShare
from pipeline.analysis.region_sentence import subject
from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.artefacts.model_card import ModelCard
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.search_results import BaseRate, Measures
from pipeline.artefacts.white_box_results import WhiteBoxMeasures
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


def headline(scenarios: Sequence[FailureRegions], rates: Sequence[BaseRate]) -> str:
    """The result of a search in words: failures by scenario, then the base failure rates."""
    sentences = []
    for regions in scenarios:
        if regions.failures == regions.tests > 0:
            outcome = f"every test fails ({regions.tests} of {regions.tests})"
        else:
            failing = f"{regions.failures} of {regions.tests} tests fail"
            outcome = f"{failing}; failure regions: {len(regions.regions)}"
        sentences.append(f"{regions.label}: {outcome}.")
    labels = {regions.scenario: regions.label for regions in scenarios}
    return " ".join([*sentences, base_rate_sentence(rates, labels)]).strip()


def largest_regions(scenarios: Sequence[FailureRegions]) -> list[str]:
    """A sentence on the largest region of each scenario; empty without a region.

    Example: `Largest failure region of the search: children at most 1.25 m tall in F1 (19
    failures).`
    """
    phrases = []
    for regions in scenarios:
        if regions.regions:
            largest = regions.regions[0]
            who = subject(largest.conditions)
            failures = count_of(len(largest.members), "failure")
            phrases.append(f"{who[0].lower()}{who[1:]} in {regions.label} ({failures})")
    if not phrases:
        return []
    noun = "region" if len(phrases) == 1 else "regions"
    return [f"Largest failure {noun} of the search: {'; '.join(phrases)}."]


def search_section(
    measures: Measures,
    white_box: WhiteBoxMeasures | None,
    labels: Mapping[str, str],
    plots: Sequence[Drawing],
    coverage: Sequence[Drawing],
    pairs: Mapping[str, Sequence[PairShare]],
) -> Section:
    """How many failures each strategy finds, and what its tests cover.

    Args:
        measures: Measures of all campaigns and strategies.
        white_box: Coverage of the detector's neurons; with None the part is left out.
        labels: Scenario -> its printed label.
        plots: Figures of the failures found.
        coverage: Figures of the coverage of the scenario space.
        pairs: Scenario -> covered pairs of categories.
    """
    cause_rows, coverage_rows = [], []
    for row in measures.strategies:
        key = (labels[row.scenario], row.strategy)
        cause_rows.append((*key, str(row.failures), *cause_cells(row.causes)))
        covered = row.pair_coverage_tests, row.pair_coverage_failures, row.projection_coverage
        coverage_rows.append((*key, *map(percent, covered)))
    cause_headers = ("scenario", "strategy", "failures", *CAUSES.values())
    parts = [
        _failures_found(measures, labels, plots),
        _theta(measures, labels),
        Passage("Failures by cause", texts.CAUSES, Table(cause_headers, tuple(cause_rows))),
    ]
    if braking := braking_in_search(measures, labels):
        table = Table(braking[0], tuple(braking[1:]), numbers=(6, 7))
        parts.append(Passage("Unnecessary braking", texts.BRAKING, table))
    columns = ("pairs in tests", "pairs in failures", "pairs tested three times")
    table = Table(("scenario", "strategy", *columns), tuple(coverage_rows), numbers=(2, 3, 4))
    parts += [
        Passage("Coverage of the scenario space", texts.COVERAGE, table, tuple(coverage)),
        _pairs(pairs, labels),
    ]
    if white_box is not None:
        parts.append(_white_box(white_box))
    introduction = texts.SEARCH.format(confidence=100 * measures.confidence)
    return Section("Search", (introduction,), tuple(parts))


def _failures_found(
    measures: Measures, labels: Mapping[str, str], plots: Sequence[Drawing]
) -> Passage:
    bases = {rate.scenario: rate_text(rate) for rate in measures.base_rates}
    rows = []
    for row in measures.strategies:
        seeds, saved = len(row.seeds), "baseline"
        if row.c_measure is not None:
            saved = censored(row.c_measure, row.c_measure_censored, seeds, "{:.2f}", "<")
        rows.append(
            (
                labels[row.scenario],
                row.strategy,
                f"{row.failures} / {row.tests - row.errors}",
                percent(row.rate),
                bases.get(row.scenario, NONE),
                censored(row.f_measure, row.f_measure_censored, seeds, "{:.0f}", ">"),
                saved,
            )
        )
    rates = ("failures / tests", "failure rate", "base failure rate")
    table = Table(("scenario", "strategy", *rates, "F", "C"), tuple(rows), numbers=(2, 3, 4))
    how = texts.MEASURES.format(baseline=measures.baseline)
    return Passage("Failures found", how, table, tuple(plots))


def _theta(measures: Measures, labels: Mapping[str, str]) -> Passage:
    """The curves of failures found in numbers."""
    rows = []
    for row in measures.strategies:
        key = (row.scenario, row.strategy)
        curves = [c.theta for c in measures.campaigns if (c.scenario, c.strategy) == key]
        length = min(map(len, curves))
        means = []
        for part in QUARTERS if length else ():
            position = max(0, round(part * length) - 1)
            means.append(mean_text(sum(curve[position] for curve in curves) / len(curves)))
        rows.append((labels[row.scenario], row.strategy, str(length), *means))
    quarters = (f"after {100 * part:.0f} % of them" for part in QUARTERS)
    return Passage(
        table=Table(("scenario", "strategy", "tests", *quarters), tuple(rows)),
        folded="Failures found after each quarter of the tests, mean over seeds",
    )


def _pairs(pairs: Mapping[str, Sequence[PairShare]], labels: Mapping[str, str]) -> Passage:
    """The heat maps in numbers."""
    rows = []
    for scenario, shares in pairs.items():
        for pair in shares:
            row = [labels[scenario], pair.first, pair.second, str(pair.feasible)]
            for covered in (pair.tests, pair.failures):
                row.append(f"{covered} = {share(covered / pair.feasible)}")
            rows.append(tuple(row))
    variables = ("scenario", "variable", "and variable")
    headers = (*variables, "pairs of categories", "in tests", "in failures")
    return Passage(
        table=Table(headers, tuple(rows), numbers=(4, 5)),
        folded=f"Covered pairs of categories in numbers ({len(rows)})",
    )


def _white_box(measures: WhiteBoxMeasures) -> Passage:
    rows = []
    for images in measures.sets:
        shares = images.neuron, images.multisection, images.strong, images.top, images.pairs
        rows.append((images.name, str(images.images), *map(share, shares)))
    criteria = ("active neurons", "sections", "strongly active", "top", "pairs")
    table = Table(("strategy", "images", *criteria), tuple(rows), numbers=(2, 3, 4, 5, 6))
    how = texts.WHITE_BOX.format(
        neurons=f"{measures.neurons:,}", layers=measures.layers, images=measures.training_images
    )
    return Passage("Coverage of the detector's neurons", how, table)


def regions_section(
    scenarios: Sequence[FailureRegions],
    rates: Sequence[BaseRate],
    plots: Mapping[str, Drawing],
    cards: Mapping[str, Sequence[Card]],
) -> Section:
    """Where the searched version fails, scenario by scenario.

    Args:
        scenarios: Failure regions of each search scenario.
        rates: Base failure rates of the searched version.
        plots: Scenario -> figure of its failures.
        cards: Scenario -> cards of its regions.
    """
    bases = {}
    for rate in rates:
        text = f" Base failure rate: {rate_text(rate)}, {rate.strategy} tests."
        bases[rate.scenario] = text
    parts = []
    for regions in scenarios:
        every = "Every test fails. " if regions.failures == regions.tests > 0 else ""
        text = (
            f"{every}{regions.failures} of {regions.tests} tests fail "
            f"({100 * regions.failure_rate:.1f} %). Regions: {len(regions.regions)}. "
            f"Isolated failures, in no region: {len(regions.isolated)}. "
            f"Connected sets of failures (Def. 4.19): {regions.connected}. "
            f"Not solvable with this camera: {len(regions.not_solvable)}."
            f"{bases.get(regions.scenario, '')}"
        )
        drawings: tuple[Drawing, ...] = (plots[regions.scenario],)
        if not regions.failures:
            text, drawings = f"{text} {texts.NO_FAILURES}", ()
        part = Passage(regions.label, text, plots=drawings, cards=tuple(cards[regions.scenario]))
        parts.append(part)
    return Section("Failure regions", (texts.REGIONS,), tuple(parts))


def data_section(
    filters: Mapping[str, pd.DataFrame],
    cards: Sequence[ModelCard],
    border: Sequence[Drawing],
    plots: Sequence[Drawing],
) -> Section | None:
    """Training data of the versions and their detection metrics on single images.

    Args:
        filters: Strategy -> its filter table.
        cards: Model cards of the versions.
        border: Figures of frames near the filter's thresholds.
        plots: Figures of the detection metrics.

    Returns:
        The section; None without filters and cards.
    """
    parts = []
    if filters:
        parts.append(_frames(filters, border))
    if cards:
        parts.append(_detection(cards, plots))
    return Section("Data and training", (), tuple(parts)) if parts else None


def _frames(filters: Mapping[str, pd.DataFrame], border: Sequence[Drawing]) -> Passage:
    reasons = dict.fromkeys(MEANINGS)
    for table in filters.values():
        reasons |= dict.fromkeys(map(str, table["reason"].unique()))
    rows = []
    for reason in reasons:
        cells = [_kept(table, reason) for table in filters.values()]
        if any(cell != NONE for cell in cells):
            rows.append((MEANINGS.get(reason, reason), *cells))
    totals = (f"{int(table['kept'].sum())} kept of {len(table)}" for table in filters.values())
    rows.append(("all", *totals))
    table = Table(("frames", *filters), tuple(rows), numbers=tuple(range(1, len(filters) + 1)))
    return Passage("Frames from the search", texts.FRAMES, table, tuple(border))


def _kept(table: pd.DataFrame, reason: str) -> str:
    """How many frames with this reason are kept and how many are rejected."""
    rows = table[table["reason"] == reason]
    kept = int(rows["kept"].sum())
    rejected = len(rows) - kept
    if rows.empty:
        return NONE
    if not rejected:
        return f"{kept} kept"
    return f"{kept} kept, {rejected} rejected" if kept else f"{rejected} rejected"


def calibration_section(
    calibrations: Sequence[DetectorCalibration], plots: Sequence[Drawing]
) -> Section:
    """How the confidences of detectors under test are calibrated."""
    rows, notes = [], []
    for calibration in calibrations:
        errors = calibration.errors["uncalibrated"], calibration.errors["calibrated"]
        numbers = map(decimal, (calibration.slope, calibration.offset, *errors))
        counts = str(calibration.detections), str(calibration.right)
        rows.append((calibration.version, *numbers, *counts))
        if not calibration.fitted:
            notes.append(texts.NOT_CALIBRATED.format(version=calibration.version))
    errors_headers = ("error before", "error after")
    headers = ("detector", "slope", "offset", *errors_headers, "detections", "correct")
    how = texts.CALIBRATION.format(images=calibrations[0].images)
    part = Passage(table=Table(headers, tuple(rows)), plots=tuple(plots), notes=tuple(notes))
    return Section("Calibration", (how,), (part,))


def _detection(cards: Sequence[ModelCard], plots: Sequence[Drawing]) -> Passage:
    rows = []
    for card in cards:
        numbers = [decimal(card.metrics.get(name)) for name in METRICS]
        numbers.append(decimal(card.metrics.get("false_positives_an_image")))
        origin = (card.version, card.parent or "none", f"{card.parameters:,}")
        rows.append((*origin, *numbers, card.weights_sha256[:12]))
    metrics = (*METRICS.values(), "false positives per image")
    headers = ("version", "parent", "parameters", *metrics, "weights")
    table = Table(headers, tuple(rows), codes=(len(headers) - 1,))
    return Passage("Single-image detection", texts.DETECTION, table, tuple(plots))
