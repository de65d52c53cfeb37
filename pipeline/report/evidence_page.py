"""The evidence for a safety case as a page to print, in the report's style."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from math import ceil

from pipeline.artefacts.evidence import Area, Areas, Domain, Evidence, Risk, ScenarioEvidence
from pipeline.report.failure_tables import CAUSES, MIXED
from pipeline.report.formats import fresh_counts, percent
from pipeline.report.page import Drawing, Page, Passage, Section, Table
from pipeline.report.region_cards import NOT_EXECUTED

NAMES = {
    "known_unsafe": "known unsafe",
    "confirmed": "of which confirmed",
    "known_safe": "known safe",
    "unknown": "unknown",
    "unknown_unsafe": "unknown unsafe",
}
COLOURS = {"known_unsafe": "#c9372c", "known_safe": "#2a9d78", "unknown": "#a3acb8"}
HIDDEN = "#e8912d"
"""Colour of the unknown unsafe area, which overlaps two of the others."""
NO_ESTIMATE = "no estimate"
HOW = (
    "The areas of Figure 8.1 of the thesis (ISO 21448), as shares of the exposure's probability. "
    "Known unsafe, known safe and unknown add up to 100 %. Unknown unsafe is the probability of a "
    "failure outside all rules; its bar shows the interval. Its rules are fitted to the tests of "
    "searches alone, so they differ from those listed below, and a part of it may lie in the known "
    "unsafe area."
)
WIDTH, BAR, LEFT = 640, 26, 130


def evidence_page(evidence: Evidence) -> Page:
    """The page of one detector's evidence."""
    areas, domains, regions = [], [], []
    if evidence.whole is not None and len(evidence.scenarios) > 1:
        areas.append(_areas("All scenarios", evidence.whole.failure, evidence.whole.areas))
    for scenario in evidence.scenarios:
        areas.append(_areas(scenario.domain.label, scenario.failure, scenario.areas))
        domains.append(_domain(scenario.domain))
        regions.append(_regions(scenario))
    exposure = f"Exposure: {evidence.exposure['description']}."
    notes = (Passage(notes=evidence.assumptions), Passage(notes=evidence.limits))
    sections = (
        Section("Areas and residual risk", (HOW,), tuple(areas)),
        Section("Operational design domain", (exposure,), tuple(domains)),
        Section("Coverage reached", (), (Passage(table=_coverage(evidence.scenarios)),)),
        Section("Open failure regions", (), tuple(regions)),
        Section("Assumptions and limits", (), notes),
        Section("Identity", (), (Passage(table=_identity(evidence)),)),
    )
    title = f"Evidence for a safety case: {evidence.model.version}"
    return Page(evidence.study, evidence.claim, sections, title)


def _areas(title: str, failure: Risk, areas: Areas) -> Passage:
    rows = []
    for field, name in NAMES.items():
        area = getattr(areas, field)
        rows.append((name, _share(area), area.definition, area.source))
    rows.append(("residual risk", _share(failure), failure.definition, failure.source))
    headers = ("area", "share, 95 % interval", "what belongs to it", "source")
    hidden = areas.unknown_unsafe
    if failure.share is None:
        counts = f"Residual risk not estimated: {failure.missing}."
    else:
        outside = f"outside all rules: {hidden.missing}"
        if hidden.share:
            outside = f"{hidden.failures:,} outside all rules"
        counts = (
            f"{failure.failures:,} of {failure.tests:,} random tests fail, {outside}; "
            f"{failure.errors:,} errors, in no share."
        )
    plot = Drawing(bars(title, areas), counts)
    return Passage(title, table=Table(headers, tuple(rows), numbers=(0,)), plots=(plot,))


def _share(area: Area) -> str:
    if area.share is None:
        return f"{NO_ESTIMATE}: {area.missing}"
    below = getattr(area, "below", None)
    if below is None:
        return percent(area.share)
    return f"{percent(area.share)}; 95 % sure: below {ceil(1000 * below - 1e-9) / 10:.1f} %"


def bars(title: str, areas: Areas) -> str:
    """The areas as one bar that fills the width, with the interval of the risk below, as SVG."""
    shares = {name: area.share.value for name in COLOURS if (area := getattr(areas, name)).share}
    place, parts = float(LEFT), []
    for name, value in shares.items():
        width = value * (WIDTH - LEFT)
        parts.append(
            f'<rect x="{place:.2f}" y="4" width="{width:.2f}" height="{BAR}" '
            f'fill="{COLOURS[name]}"/>'
        )
        place += width
    keys = [(COLOURS[name], NAMES[name]) for name in shares]
    if (risk := areas.unknown_unsafe.share) is not None:
        low, middle, high = (
            LEFT + value * (WIDTH - LEFT) for value in (risk.low, risk.value, risk.high)
        )
        parts += [
            f'<rect x="{low:.2f}" y="40" width="{max(high - low, 1):.2f}" height="10" '
            f'fill="{HIDDEN}"/>',
            f'<rect x="{middle - 1:.2f}" y="37" width="2" height="16" fill="currentColor"/>',
        ]
        keys.append((HIDDEN, "95 %, mark: estimate"))
    for text, y in (("areas", 22), ("unknown unsafe", 50)):
        parts.append(f'<text x="0" y="{y}" font-size="13" fill="currentColor">{text}</text>')
    for index, (colour, text) in enumerate(keys):
        x = LEFT + 120 * index
        parts += [
            f'<rect x="{x}" y="62" width="12" height="12" fill="{colour}"/>',
            f'<text x="{x + 18}" y="73" font-size="12" fill="currentColor">{text}</text>',
        ]
    spoken = ", ".join(f"{name} {_share(getattr(areas, field))}" for field, name in NAMES.items())
    head = (
        f'<svg role="img" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} 78" '
        f'aria-label="{escape(f"{title}: {spoken}")}">'
    )
    return head + "".join(parts) + "</svg>"


def _domain(domain: Domain) -> Passage:
    rows = []
    for name, variable in domain.variables.items():
        values = variable.get("values")
        if not isinstance(values, list):
            values = [f"{variable['low']:g} to {variable['high']:g}"]
        rows.append((name, str(variable.get("unit", "")), ", ".join(map(str, values))))
    table = Table(("variable", "unit", "values"), tuple(rows), codes=(0,))
    clauses = tuple(" or ".join(clause) for clause in domain.constraints)
    return Passage(domain.label, domain.description, table, notes=clauses)


def _coverage(scenarios: Sequence[ScenarioEvidence]) -> Table:
    rows = []
    for scenario in scenarios:
        coverage = scenario.coverage
        cells = f"{coverage.covered:,} of {coverage.required:,}"
        ratio = f"{100 * coverage.ratio:.1f} %"
        projection = f"{coverage.k}-projection"
        rows.append((scenario.domain.label, projection, cells, ratio, f"{coverage.tests:,}"))
    columns = ("projection", "cells with a test", "coverage", "tests of all strategies")
    return Table(("scenario", *columns), tuple(rows))


def _regions(scenario: ScenarioEvidence) -> Passage:
    title = scenario.domain.label
    text = f"Failures in no region: {scenario.isolated_failures}."
    if not scenario.open_regions:
        return Passage(title, f"No failure region was found. {text}")
    rows = []
    for region in scenario.open_regions:
        fresh = (NOT_EXECUTED, NOT_EXECUTED)
        if tested := region.confirmation:
            fresh = (fresh_counts(tested.inside), fresh_counts(tested.outside))
        cause, failures = CAUSES.get(region.cause, MIXED), str(region.failures)
        shares = (percent(region.share), region.status)
        rows.append((region.name, region.rule, cause, failures, *shares, *fresh))
    described = ("region", "rule", "cause", "failures", "share of the exposure", "status")
    headers = (*described, "fresh tests that fail inside", "just outside")
    return Passage(title, text, Table(headers, tuple(rows), numbers=(3,), codes=(1,)))


def _identity(evidence: Evidence) -> Table:
    model = evidence.model
    rows = [("detector", f"{model.version}, {model.file}", model.sha256)]
    if model.weights_sha256:
        rows.append(("weights", model.version, model.weights_sha256))
    rows += [("training data", name, digest) for name, digest in model.data.items()]
    rows.append(("settings", f"study {evidence.study}", evidence.settings_sha256))
    for path, digest in evidence.files.items():
        if path != model.file:
            rows.append(("file", path, digest))
    return Table(("what", "name", "SHA-256"), tuple(rows), codes=(2,))
