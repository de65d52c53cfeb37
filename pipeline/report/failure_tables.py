"""Failures by cause, unnecessary braking, base failure rates, for the report and the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.failure_counts import Causes, FalseActivations
from pipeline.artefacts.search_results import BaseRate, Measures
from pipeline.report.formats import percent

CAUSES = {
    "never_seen": "never seen",
    "lost_after_detection": "lost after detection",
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
"""Number of base failure rates that a sentence lists."""


def cause_cells(causes: Causes) -> tuple[str, ...]:
    """Number of failures by cause, in the order of `CAUSES`."""
    return tuple(str(getattr(causes, cause)) for cause in CAUSES)


def braking_cells(activations: FalseActivations) -> tuple[str, ...]:
    """Unnecessary braking, in the order of `BRAKING`; a mean of nothing is a dash."""
    duration, loss = activations.mean_duration_s, activations.mean_speed_loss_mps
    counts = activations.tests, activations.braking, activations.number
    return (
        *map(str, counts),
        NONE if duration is None else f"{duration:.2f} s",
        NONE if loss is None else f"{loss:.1f} m/s ({3.6 * loss:.0f} km/h)",
    )


def braking_in_search(
    measures: Measures, labels: Mapping[str, str] | None = None
) -> list[tuple[str, ...]]:
    """Unnecessary braking in each campaign.

    Args:
        measures: Measures of all strategies.
        labels: Scenario -> its printed label.

    Returns:
        Rows of version, scenario, strategy and `braking_cells`, headers first; empty if the right
        answer is to brake in all scenarios.
    """
    rows: list[tuple[str, ...]] = [("version", "scenario", "strategy", *BRAKING)]
    for row in measures.strategies:
        if row.scenario in measures.no_braking:
            label = (labels or {}).get(row.scenario, row.scenario)
            rows.append((row.version, label, row.strategy, *braking_cells(row.false_activations)))
    return rows if len(rows) > 1 else []


def braking_held_out(comparison: Comparison) -> list[tuple[str, ...]]:
    """Unnecessary braking of each version on held-out tests.

    Returns:
        Rows of version, scenario and `braking_cells`, headers first; empty if the right answer is
        to brake in all scenarios.
    """
    rows: list[tuple[str, ...]] = [("version", "scenario", *BRAKING)]
    for result in comparison.versions:
        for name in comparison.no_braking:
            cells = braking_cells(result.scenarios[name].false_activations)
            rows.append((result.version, comparison.scenarios[name], *cells))
    return rows if len(rows) > 1 else []


def rate_text(rate: BaseRate) -> str:
    """`4 / 160 = 2.5 % (0.7 to 6.3)`."""
    return f"{rate.failures:,} / {rate.tests:,} = {percent(rate.rate)}"


def base_rate_sentence(rates: Sequence[BaseRate], labels: Mapping[str, str] | None = None) -> str:
    """The base failure rate of each search scenario; of many, the lowest and the highest.

    Args:
        rates: Base failure rates, one a scenario; without any the sentence is empty.
        labels: Scenario -> its printed label.
    """
    if not rates:
        return ""
    listed = rates
    if len(rates) > MOST_RATES:
        by_rate = sorted(rates, key=lambda rate: rate.rate.value)
        listed = (by_rate[0], by_rate[-1])
    each = []
    for rate in listed:
        each.append(f"{(labels or {}).get(rate.scenario, rate.scenario)} {rate_text(rate)}")
    text = ", ".join(each)
    if listed is not rates:
        text = f"from {' to '.join(each)}, in {len(rates)} scenarios"
    return f"Base failure rate ({rates[0].version}, {rates[0].strategy} tests): {text}."
