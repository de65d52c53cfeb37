"""The verdict on the model versions as a plain table, for the terminal and the report."""

from __future__ import annotations

from pathlib import Path

from pipeline.artefacts.results import Comparison, VersionResult

HEADERS = ("version", "failures / tests", "change", "p", "verdict")


def verdict_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """One row a version, columns as `HEADERS`; the champion carries a star."""
    return [_row(result, comparison.champion) for result in comparison.versions]


def verdict_table(comparison: Comparison, report: Path) -> str:
    """The table with a line on how to read it and, last, where to look next. report: path of the page."""
    rows = [HEADERS, *verdict_rows(comparison)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADERS))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    lines.insert(1, "  ".join("─" * width for width in widths))
    scenarios = " + ".join(comparison.scenarios.values())
    lines.insert(0, f"Held out: {scenarios}, the same tests for every version\n")
    lines += ["", *verdict_sentences(comparison), ""]
    lines.append(f"Look next: {report} (open it in a browser); ./run ui (MLflow: compare the versions of the model)")
    return "\n".join(lines)


def verdict_sentences(comparison: Comparison) -> list[str]:
    """What the table says, in words."""
    method = f"p: exact McNemar test against base on the same tests; a difference counts at p ≤ {comparison.alpha:g}"
    sentences = [f"★ champion: {comparison.champion}. {method}, otherwise none is shown; not corrected for three comparisons."]
    sentences += [f"{version} {reason}." for version, reason in comparison.gate.items() if version != comparison.versions[0].version]
    if comparison.adaptive_against_random is not None:
        paired = comparison.adaptive_against_random
        fixes, regressions = len(paired.fixes), len(paired.regressions)
        outcome = f"passes {fixes} tests that random fails, fails {regressions} that random passes"
        sentences.append(f"adaptive against random: {outcome} (p = {paired.p_value:.2g}).")
    broken = {result.version: result.errors for result in comparison.versions if result.errors}
    if broken:
        counts = ", ".join(f"{count} of {version}" for version, count in broken.items())
        sentences.append(f"Simulations that broke and do not count: {counts}.")
    return sentences


def _row(result: VersionResult, champion: str) -> tuple[str, ...]:
    name = f"{result.version} ★" if result.version == champion else result.version
    share = f"{result.failures} / {result.tests}"
    if result.paired is None:
        return name, share, "", "", result.verdict
    change = f"{result.change:+d}" if result.change else "0"
    detail = f"{change} ({len(result.paired.fixes)} fixed, {len(result.paired.regressions)} new)"
    return name, share, detail, f"{result.paired.p_value:.2g}", result.verdict
