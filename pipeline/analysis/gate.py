"""The gate on the held-out tests: the parts in which a version must not get worse, and the gate's reason in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.analysis.held_out import HeldOut
from pipeline.artefacts.comparison_results import GroupPair, VersionResult
from pipeline.core.comparison import Bools
from pipeline.core.gate import Gate, Measure, Part, Policy, RiseLimit

RATES: dict[Measure, str] = {
    "failures": "the failure rate",
    "false activations": "the rate of false activations",
}


def parts_of(held_out: HeldOut, groups: Mapping[str, Bools]) -> list[Part]:
    """The scenarios under their printed names, and the named groups, which pool the scenarios. groups: name -> (n,) bool.

    Failures are limited in scenarios that ask to brake, false activations in those that ask not to: counted together, fewer of one would
    hide more of the other. A part without tests is left out.
    """
    calm = np.isin([test.scenario for test in held_out.tests], held_out.no_braking)
    measures: dict[Measure, Bools] = {"failures": ~calm, "false activations": calm}
    places = [
        *((held_out.labels[name], rows) for name, rows in held_out.scenarios.items()),
        *groups.items(),
    ]
    parts = [
        Part(name, measure, rows & of) for measure, of in measures.items() for name, rows in places
    ]
    return [part for part in parts if part.rows.any()]


def gate_reason(
    found: Gate, base: VersionResult, version: VersionResult, over_seeds: GroupPair, policy: Policy
) -> str:
    """Why the gate passes a version or holds it back: the first condition that fails, in the order of `Gate`.

    over_seeds: the version's group against the base. Parts that are too small to judge are named if the version passes, because it has
    shown nothing there.
    """
    p_value = 1.0 if version.paired is None else version.paired.p_value
    if found.more_errors:
        return f"held back: {version.errors} errors, {base.errors} with {base.version}"
    if not found.fewer:
        how_many = "significantly more" if version.verdict == "worse" else "not significantly fewer"
        return f"held back: {how_many} failures than {base.version} (p = {p_value:.2g})"
    if not found.fewer_over_seeds:
        mean = over_seeds.difference
        difference = (
            f"{mean.value:+.1f}, {mean.low:+.1f} to {mean.high:+.1f}; p = {over_seeds.p_value:.2g}"
        )
        return f"held back: over all its seeds, {version.group} does not show fewer failures than {base.version} ({difference})"
    if above := found.limits_that_are("above the margin"):
        return f"held back: {_rises(above)}, more than the margin of {100 * policy.margin:g} points"
    reason = f"passes: significantly fewer failures than {base.version} (p = {p_value:.2g})"
    if within := {limit.measure for limit in found.limits_that_are("within the margin")}:
        level = f"{100 * policy.confidence:g} % upper limits"
        rates = " and ".join(rate for measure, rate in RATES.items() if measure in within)
        rise = "rises" if len(within) == 1 else "rise"
        reason += f"; {rates} {rise} by at most {100 * policy.margin:g} points in each judged scenario and group ({level})"
    small = ", ".join(map(_name, found.limits_that_are("too small to judge")))
    return f"{reason}; too small to judge: {small}" if small else reason


def _rises(limits: Sequence[RiseLimit]) -> str:
    """`the failure rate may rise by up to 14.0 points (F2*), 12.3 points (children)`, and the same for false activations."""
    by_measure = {
        measure: [limit for limit in limits if limit.measure == measure] for measure in RATES
    }
    clauses = [
        f"{RATES[measure]} may rise by up to {', '.join(f'{_points(limit.limit)} ({limit.name})' for limit in chosen)}"
        for measure, chosen in by_measure.items()
        if chosen
    ]
    return " and ".join(clauses)


def _name(limit: RiseLimit) -> str:
    return limit.name if limit.measure == "failures" else f"{limit.measure} in {limit.name}"


def _points(share: float) -> str:
    return f"{100 * share:.1f} points"
