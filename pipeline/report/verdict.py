"""The verdict on the model versions as a plain table, for the terminal and the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pipeline.artefacts.comparison_results import Comparison, GroupPair, VersionResult
from pipeline.artefacts.results import Estimate
from pipeline.core.lineage import Version

HEADERS = ("version", "failures / tests", "change", "p", "verdict")


def verdict_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """One row a version, columns as `HEADERS`; the champion carries a star."""
    return [_row(result, comparison.champion) for result in comparison.versions]


def verdict_table(comparison: Comparison, report: Path) -> str:
    """The table with a line on how to read it and, last, where to look next. report: path of the page."""
    scenarios = " + ".join(comparison.scenarios.values())
    lines = [f"Held out: {scenarios}, the same tests for every version\n", *_aligned([HEADERS, *verdict_rows(comparison)])]
    if len(comparison.groups) < len(comparison.versions) or len(comparison.scenarios) > 1:
        lines += ["", f"Failures by scenario, {_averaged(comparison)}\n", *_aligned([group_headers(comparison), *group_rows(comparison)])]
    lines += ["", *verdict_sentences(comparison), ""]
    lines.append(f"Look next: {report} (open it in a browser); ./run ui (MLflow: compare the versions of the model)")
    return "\n".join(lines)


def verdict_sentences(comparison: Comparison) -> list[str]:
    """What the table says, in words."""
    method = f"p: exact McNemar test against base on the same tests; a difference counts at p ≤ {comparison.alpha:g}"
    sentences = [f"★ champion: {comparison.champion}. {method}, otherwise none is shown; not corrected for several comparisons."]
    if (passing := sum(map(comparison.passes, comparison.gate))) > 1:
        picked = f"{comparison.champion} is the best of {passing} that pass, picked on these very tests"
        sentences.append(f"{picked}: expect more failures of it on others.")
    sentences += [_group_sentence(comparison, pair) for pair in comparison.group_pairs if _rivals(pair)]
    sentences += [f"{version} {reason}." for version, reason in comparison.gate.items() if version != comparison.versions[0].version]
    errors = {result.version: result.errors for result in comparison.versions if result.errors}
    if errors:
        counts = ", ".join(f"{count} of {version}" for version, count in errors.items())
        sentences.append(f"Errors, which do not count: {counts}.")
    return sentences


def _rivals(pair: GroupPair) -> bool:
    """Whether it answers thesis chapter 7: adaptive frames against random ones, or against no new frames, in the same round."""
    group, against = Version.named(pair.group), Version.named(pair.against)
    return group.kind == "adaptive" and against.kind in ("random", "control") and group.round == against.round


def _group_sentence(comparison: Comparison, pair: GroupPair) -> str:
    paired = comparison.pair(pair.group, pair.against)
    seeds = len(next(group.versions for group in comparison.groups if group.group == pair.group))
    if seeds == 1 and paired is not None:
        outcome = f"passes {len(paired.fixes)} tests that {pair.against} fails, fails {len(paired.regressions)} that {pair.against} passes"
        return f"{pair.group} against {pair.against}: {outcome} (p = {pair.p_value:.2g})."
    mean = pair.difference
    outcome = f"{mean.value:+.1f} failures, mean of {seeds} seeds ({mean.low:+.1f} to {mean.high:+.1f})"
    p_value = f"p = {pair.p_value:.2g}, exact sign-flip test over the tests, seeds summed"
    luck = pair.p_value <= comparison.alpha and not pair.shown(comparison.alpha)
    return f"{pair.group} against {pair.against}: {outcome}; {p_value}{', but within the luck of training' if luck else ''}."


def _row(result: VersionResult, champion: str) -> tuple[str, ...]:
    name = f"{result.version} ★" if result.version == champion else result.version
    share = f"{result.failures} / {result.tests}"
    if result.paired is None:
        return name, share, "", "", result.verdict
    change = f"{result.change:+d}" if result.change else "0"
    detail = f"{change} ({len(result.paired.fixes)} fixed, {len(result.paired.regressions)} new)"
    return name, share, detail, f"{result.paired.p_value:.2g}", result.verdict


def group_headers(comparison: Comparison) -> tuple[str, ...]:
    """Of `group_rows`."""
    return "version", *comparison.scenarios.values(), "all", "of base"


def group_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """Failures by scenario, as thesis Table 7.2: one row for the versions that differ by the seed of retraining alone."""
    return [
        (
            group.group,
            *(_counted(group.scenarios[name]) for name in comparison.scenarios),
            _counted(group.failures),
            "" if group.against_base is None else f"{group.against_base:.2f}",
        )
        for group in comparison.groups
    ]


def _averaged(comparison: Comparison) -> str:
    seeds = max(len(group.versions) for group in comparison.groups)
    several = f"means over {seeds} seeds of retraining with Student's intervals, single versions with Wilson's"
    return several if seeds > 1 else "one seed of retraining, with Wilson's intervals"


def mean_text(value: float) -> str:
    """`76.3`, and `154` without a decimal."""
    return f"{value:.1f}".removesuffix(".0")


def _counted(estimate: Estimate) -> str:
    value = mean_text(estimate.value)
    return value if estimate.low == estimate.high else f"{value} ({estimate.low:.0f}–{estimate.high:.0f})"


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Lines of a table whose first row is the head."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return [lines[0], "  ".join("─" * width for width in widths), *lines[1:]]
