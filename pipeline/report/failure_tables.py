"""Tables of failures by cause and of unnecessary braking, and the base failure rate in words: for the report and the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.failure_counts import Causes, FalseActivations
from pipeline.artefacts.search_results import BaseRate, Measures
from pipeline.report.formats import percent

CAUSES = {
    "never_seen": "never seen",
    "too_late": "too late",
    "box": "box disagrees",
    "confidence": "confidence too low",
    "false_positives": "false positives",
    "not_solvable": "not solvable by the camera",
    "false_activation": "unnecessary braking",
}
"""Cause of a failure -> its name in tables."""
MIXED = "several causes"
BRAKING = (
    "tests",
    "with a false activation",
    "false activations",
    "mean duration",
    "mean speed loss",
)
"""Headers of `braking_cells`."""
NONE = "–"
MOST_RATES = 3
"""Number of base failure rates that a sentence tells one by one."""


def cause_cells(causes: Causes) -> tuple[str, ...]:
    """Number of failures by cause, in the order of `CAUSES`."""
    return tuple(str(getattr(causes, cause)) for cause in CAUSES)


def braking_cells(found: FalseActivations) -> tuple[str, ...]:
    """Unnecessary braking, in the order of `BRAKING`; a mean of nothing is a dash."""
    duration, loss = found.mean_duration_s, found.mean_speed_loss_mps
    means = (
        NONE if duration is None else f"{duration:.2f} s",
        NONE if loss is None else f"{loss:.1f} m/s ({3.6 * loss:.0f} km/h)",
    )
    return str(found.tests), str(found.braking), str(found.number), *means


def braking_in_search(
    measures: Measures, labels: Mapping[str, str] | None = None
) -> list[tuple[str, ...]]:
    """Rows of version, scenario, strategy and `braking_cells`, headers first; none if all scenarios ask to brake. labels: of scenarios."""
    rows = [
        (
            row.version,
            (labels or {}).get(row.scenario, row.scenario),
            row.strategy,
            *braking_cells(row.false_activations),
        )
        for row in measures.strategies
        if row.scenario in measures.no_braking
    ]
    return [("version", "scenario", "strategy", *BRAKING), *rows] if rows else []


def braking_held_out(comparison: Comparison) -> list[tuple[str, ...]]:
    """Rows of version, scenario and `braking_cells`, headers first; none if all scenarios ask to brake."""
    rows = [
        (
            result.version,
            comparison.scenarios[name],
            *braking_cells(result.scenarios[name].false_activations),
        )
        for result in comparison.versions
        for name in comparison.no_braking
    ]
    return [("version", "scenario", *BRAKING), *rows] if rows else []


def rate_text(rate: BaseRate) -> str:
    """`4 / 160 = 2.5 % (0.7 to 6.3)`."""
    return f"{rate.failures:,} / {rate.tests:,} = {percent(rate.rate)}"


def base_rate_sentence(rates: Sequence[BaseRate], labels: Mapping[str, str] | None = None) -> str:
    """The base failure rate of each search scenario, or of many the lowest and the highest; empty without rates. labels: of scenarios."""
    if not rates:
        return ""
    by_rate = sorted(rates, key=lambda rate: rate.rate.value)
    told = rates if len(rates) <= MOST_RATES else (by_rate[0], by_rate[-1])
    each = [
        f"{(labels or {}).get(rate.scenario, rate.scenario)} {rate_text(rate)}" for rate in told
    ]
    text = (
        ", ".join(each) if told is rates else f"from {' to '.join(each)}, in {len(rates)} scenarios"
    )
    return f"Base failure rate ({rates[0].version}, {rates[0].strategy} tests): {text}."
