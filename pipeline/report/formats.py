"""How the report writes numbers."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.artefacts.region_results import Fresh
from pipeline.artefacts.results import Estimate


def share(value: float) -> str:
    """`12.5 %`, of a share in [0, 1]."""
    return f"{100 * value:.1f} %"


def percent(estimate: Estimate) -> str:
    """`12.5 % (8.0 to 18.9)`; without a spread `12.5 %`."""
    value = share(estimate.value)
    if estimate.low == estimate.high:
        return value
    return f"{value} ({100 * estimate.low:.1f} to {100 * estimate.high:.1f})"


def fresh_counts(fresh: Fresh) -> str:
    """Failures among the fresh tests that judge a region.

    Example: `3 / 20 = 15.0 % (3.2 to 37.9); errors: 1`.
    """
    rate = f" = {percent(fresh.rate)}" if fresh.rate else ""
    errors = f"; errors: {fresh.errors}" if fresh.errors else ""
    return f"{fresh.failures} / {fresh.tests}{rate}{errors}"


def mean_text(value: float) -> str:
    """`76.3`, and `154` without a decimal."""
    return f"{value:.1f}".removesuffix(".0")


def counted(estimate: Estimate) -> str:
    """`76.3 (70–82)`; without a spread `76.3`."""
    value = mean_text(estimate.value)
    if estimate.low == estimate.high:
        return value
    return f"{value} ({estimate.low:.0f}–{estimate.high:.0f})"


def signed(mean: Estimate) -> str:
    """`-15.0 (-18.0 to -12.0)`; without a spread `-15.0`."""
    return f"{mean.value:+.1f}{interval(mean)}"


def interval(mean: Estimate) -> str:
    """` (-18.0 to -12.0)`, of a difference; empty without a spread."""
    return "" if mean.low == mean.high else f" ({mean.low:+.1f} to {mean.high:+.1f})"


def censored(estimate: Estimate, count: int, seeds: int, form: str, beyond: str) -> str:
    """A mean over seeds, some of them censored.

    Args:
        estimate: The mean with its interval.
        count: Number of censored seeds.
        seeds: Number of all seeds.
        form: Format of a number, such as `{:.0f}`.
        beyond: Sign of a bound, `<` or `>`.

    Returns:
        For example `37 (20 to 54), 1 of 3 censored` or `> 80, 3 of 3 censored`.
    """
    text = form.format(estimate.value)
    if count == seeds:
        text = f"{beyond} {text}"
    if estimate.low != estimate.high:
        text += f" ({form.format(estimate.low)} to {form.format(estimate.high)})"
    return f"{text}, {count} of {seeds} censored" if count else text


def decimal(value: float | None) -> str:
    """`0.875`, or `n/a`."""
    return "n/a" if value is None else f"{value:.3f}"


def in_columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines with aligned cells, two spaces between columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        lines.append("  ".join(cells).rstrip())
    return lines


def aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Lines of a table; its first row holds the headers."""
    rule = tuple("─" * max(map(len, column)) for column in zip(*rows, strict=True))
    return in_columns([rows[0], rule, *rows[1:]])
