"""The evidence for a safety case as a page to print: the numbers of evidence/<version>.json in the report's style."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from math import ceil

from pipeline.artefacts.evidence import (
    Area,
    Areas,
    Coverage,
    Domain,
    Evidence,
    OpenRegion,
    Risk,
    ScenarioEvidence,
)
from pipeline.report.failure_tables import CAUSES, MIXED
from pipeline.report.formats import percent
from pipeline.report.fresh_counts import fresh_counts
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
"""Colour of the unknown unsafe area, which lies in two of the others."""
NO_ESTIMATE = "no estimate"
HOW = (
    "The areas of Figure 8.1 of the thesis (ISO 21448), as shares of the exposure's probability. Known unsafe, known safe and unknown add "
    "up to 100 %. Unknown unsafe is the probability of a failure outside all rules: its bar shows the interval. Its rules are fitted to "
    "the tests of searches alone, so they differ from those listed below, and a part of it may lie in the known unsafe area."
)
WIDTH, BAR, LEFT = 640, 26, 130


def evidence_page(evidence: Evidence) -> Page:
    """The page of one detector's evidence."""
    together = evidence.whole is not None and len(evidence.scenarios) > 1
    whole = (
        [_areas("All scenarios", evidence.whole.failure, evidence.whole.areas)]
        if evidence.whole and together
        else []
    )
    each = [_areas(one.domain.label, one.failure, one.areas) for one in evidence.scenarios]
    sections = (
        Section("Areas and residual risk", (HOW,), (*whole, *each)),
        Section(
            "Operational design domain",
            (f"Exposure: {evidence.exposure['description']}.",),
            tuple(_domain(one.domain) for one in evidence.scenarios),
        ),
        Section("Coverage reached", (), (Passage(table=_coverage(evidence.scenarios)),)),
        Section("Open failure regions", (), tuple(map(_regions, evidence.scenarios))),
        Section(
            "Assumptions and limits",
            (),
            (Passage(notes=evidence.assumptions), Passage(notes=evidence.limits)),
        ),
        Section("Identity", (), (Passage(table=_identity(evidence)),)),
    )
    return Page(
        evidence.study,
        evidence.claim,
        sections,
        f"Evidence for a safety case: {evidence.model.version}",
    )


def _areas(title: str, failure: Risk, areas: Areas) -> Passage:
    rows = [
        (NAMES[name], _share(area), area.definition, area.source) for name, area in _each(areas)
    ]
    rows.append(("residual risk", _share(failure), failure.definition, failure.source))
    table = Table(
        ("area", "share, 95 % interval", "what belongs to it", "source"), tuple(rows), numbers=(0,)
    )
    return Passage(
        title, table=table, plots=(Drawing(bars(title, areas), _counts(failure, areas)),)
    )


def _each(areas: Areas) -> list[tuple[str, Area]]:
    return [(name, getattr(areas, name)) for name in NAMES]


def _share(area: Area) -> str:
    if area.share is None:
        return f"{NO_ESTIMATE}: {area.missing}"
    below = getattr(area, "below", None)
    return (
        percent(area.share)
        if below is None
        else f"{percent(area.share)}; 95 % sure: below {ceil(1000 * below - 1e-9) / 10:.1f} %"
    )


def _counts(failure: Risk, areas: Areas) -> str:
    hidden = areas.unknown_unsafe
    if failure.share is None:
        return f"Residual risk not estimated: {failure.missing}."
    outside = (
        f"{hidden.failures:,} outside all rules"
        if hidden.share
        else f"outside all rules: {hidden.missing}"
    )
    return f"{failure.failures:,} of {failure.tests:,} random tests fail, {outside}; {failure.errors:,} errors, in no share."


def bars(title: str, areas: Areas) -> str:
    """The areas as one bar that fills the width, and the interval of the risk below it, as SVG."""
    shares = {name: area.share.value for name in COLOURS if (area := getattr(areas, name)).share}
    place, parts = float(LEFT), []
    for name, value in shares.items():
        width = value * (WIDTH - LEFT)
        parts.append(
            f'<rect x="{place:.2f}" y="4" width="{width:.2f}" height="{BAR}" fill="{COLOURS[name]}"/>'
        )
        place += width
    if (risk := areas.unknown_unsafe.share) is not None:
        low, high = (LEFT + value * (WIDTH - LEFT) for value in (risk.low, risk.high))
        parts.append(
            f'<rect x="{low:.2f}" y="40" width="{max(high - low, 1):.2f}" height="10" fill="{HIDDEN}"/>'
        )
        middle = LEFT + risk.value * (WIDTH - LEFT)
        parts.append(
            f'<rect x="{middle - 1:.2f}" y="37" width="2" height="16" fill="currentColor"/>'
        )
    labels = [("areas", 22), ("unknown unsafe", 50)]
    parts += [
        f'<text x="0" y="{y}" font-size="13" fill="currentColor">{text}</text>'
        for text, y in labels
    ]
    keys = [(COLOURS[name], NAMES[name]) for name in shares]
    if risk is not None:
        keys.append((HIDDEN, "95 %, mark: estimate"))
    parts += [_key(index, *key) for index, key in enumerate(keys)]
    spoken = ", ".join(f"{NAMES[name]} {_share(area)}" for name, area in _each(areas))
    head = f'<svg role="img" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} 78" aria-label="{escape(f"{title}: {spoken}")}">'
    return head + "".join(parts) + "</svg>"


def _key(index: int, colour: str, text: str) -> str:
    x = LEFT + 120 * index
    box = f'<rect x="{x}" y="62" width="12" height="12" fill="{colour}"/>'
    return f'{box}<text x="{x + 18}" y="73" font-size="12" fill="currentColor">{text}</text>'


def _domain(domain: Domain) -> Passage:
    rows = tuple(_variable(name, variable) for name, variable in domain.variables.items())
    table = Table(("variable", "unit", "values"), rows, codes=(0,))
    return Passage(
        domain.label,
        domain.description,
        table,
        notes=tuple(" or ".join(clause) for clause in domain.constraints),
    )


def _variable(name: str, plain: dict[str, object]) -> tuple[str, str, str]:
    values = plain.get("values")
    text = (
        ", ".join(map(str, values))
        if isinstance(values, list)
        else " to ".join(f"{plain[end]:g}" for end in ("low", "high"))
    )
    return name, str(plain.get("unit", "")), text


def _coverage(scenarios: Sequence[ScenarioEvidence]) -> Table:
    rows = tuple((one.domain.label, *_covered(one.coverage)) for one in scenarios)
    return Table(
        ("scenario", "projection", "cells with a test", "coverage", "tests of all strategies"), rows
    )


def _covered(coverage: Coverage) -> tuple[str, ...]:
    cells = f"{coverage.covered:,} of {coverage.required:,}"
    return f"{coverage.k}-projection", cells, f"{100 * coverage.ratio:.1f} %", f"{coverage.tests:,}"


def _regions(found: ScenarioEvidence) -> Passage:
    title, text = found.domain.label, f"Failures in no region: {found.isolated_failures}."
    if not found.open_regions:
        return Passage(title, f"No failure region was found. {text}")
    headers = (
        "region",
        "rule",
        "cause",
        "failures",
        "share of the exposure",
        "status",
        "fresh tests that fail inside",
        "just outside",
    )
    return Passage(
        title,
        text,
        Table(headers, tuple(map(_region, found.open_regions)), numbers=(3,), codes=(1,)),
    )


def _region(region: OpenRegion) -> tuple[str, ...]:
    tested = region.confirmation
    fresh = (
        (fresh_counts(tested.inside), fresh_counts(tested.outside))
        if tested
        else (NOT_EXECUTED, NOT_EXECUTED)
    )
    return (
        region.name,
        region.rule,
        CAUSES.get(region.cause, MIXED),
        str(region.failures),
        percent(region.share),
        region.status,
        *fresh,
    )


def _identity(evidence: Evidence) -> Table:
    model = evidence.model
    rows = [("detector", f"{model.version}, {model.file}", model.sha256)]
    if model.weights_sha256:
        rows.append(("weights", model.version, model.weights_sha256))
    rows += [("training data", name, digest) for name, digest in model.data.items()]
    rows += [("settings", f"study {evidence.study}", evidence.settings_sha256)]
    rows += [
        ("file", path, digest) for path, digest in evidence.files.items() if path != model.file
    ]
    return Table(("what", "name", "SHA-256"), tuple(rows), codes=(2,))
