"""How the report writes numbers."""

from __future__ import annotations

from pipeline.artefacts.results import Estimate


def percent(estimate: Estimate) -> str:
    """`12.5 % (8.0 to 18.9)`."""
    value = f"{100 * estimate.value:.1f} %"
    return value if estimate.low == estimate.high else f"{value} ({100 * estimate.low:.1f} to {100 * estimate.high:.1f})"


def mean_text(value: float) -> str:
    """`76.3`, and `154` without a decimal."""
    return f"{value:.1f}".removesuffix(".0")


def counted(estimate: Estimate) -> str:
    """`76.3 (70–82)`."""
    value = mean_text(estimate.value)
    return value if estimate.low == estimate.high else f"{value} ({estimate.low:.0f}–{estimate.high:.0f})"


def signed(mean: Estimate) -> str:
    """`-15.0 (-18.0 to -12.0)`."""
    return f"{mean.value:+.1f} ({mean.low:+.1f} to {mean.high:+.1f})"


def over_seeds(estimate: Estimate | None, having: int, seeds: int, form: str) -> str:
    """The mean over the seeds that have a value, with the number of these seeds if some have none."""
    if estimate is None:
        return "n/a"
    text = form.format(estimate.value)
    if estimate.low != estimate.high:
        text += f" ({form.format(estimate.low)} to {form.format(estimate.high)})"
    return text if having == seeds else f"{text} in {having} of {seeds} seeds"


def decimal(value: float | None) -> str:
    """`0.875`, or `n/a`."""
    return "n/a" if value is None else f"{value:.3f}"
