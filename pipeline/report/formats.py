"""How the report writes numbers."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.artefacts.results import Estimate


def share(value: float) -> str:
    """`12.5 %`, of a share in [0, 1]."""
    return f"{100 * value:.1f} %"


def percent(estimate: Estimate) -> str:
    """`12.5 % (8.0 to 18.9)`."""
    value = share(estimate.value)
    return (
        value
        if estimate.low == estimate.high
        else f"{value} ({100 * estimate.low:.1f} to {100 * estimate.high:.1f})"
    )


def mean_text(value: float) -> str:
    """`76.3`, and `154` without a decimal."""
    return f"{value:.1f}".removesuffix(".0")


def counted(estimate: Estimate) -> str:
    """`76.3 (70–82)`."""
    value = mean_text(estimate.value)
    return (
        value
        if estimate.low == estimate.high
        else f"{value} ({estimate.low:.0f}–{estimate.high:.0f})"
    )


def signed(mean: Estimate) -> str:
    """`-15.0 (-18.0 to -12.0)`; `-15.0` without a spread: one seed, or several that differ equally."""
    return f"{mean.value:+.1f}{interval(mean)}"


def interval(mean: Estimate) -> str:
    """` (-18.0 to -12.0)`, of a difference; empty without a spread."""
    return "" if mean.low == mean.high else f" ({mean.low:+.1f} to {mean.high:+.1f})"


def censored(estimate: Estimate, count: int, seeds: int, form: str, beyond: str) -> str:
    """A mean over seeds, of which `count` are censored: `37 (20 to 54), 1 of 3 censored`, and `> 80, 3 of 3 censored`.

    form: of one number. beyond: the sign of a bound.
    """
    text = (
        f"{beyond} {form.format(estimate.value)}" if count == seeds else form.format(estimate.value)
    )
    if estimate.low != estimate.high:
        text += f" ({form.format(estimate.low)} to {form.format(estimate.high)})"
    return f"{text}, {count} of {seeds} censored" if count else text


def decimal(value: float | None) -> str:
    """`0.875`, or `n/a`."""
    return "n/a" if value is None else f"{value:.3f}"


def in_columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines with aligned cells."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Lines of a table; its first row holds the headers."""
    rule = tuple("─" * max(map(len, column)) for column in zip(*rows, strict=True))
    return in_columns([rows[0], rule, *rows[1:]])
