"""The gate on the held-out tests: its parts, in which no version may get worse, and its reason."""

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
    """The parts of the gate: scenarios under their printed names, then named groups.

    Failures are limited in scenarios in which the right answer is to brake, false activations in
    the others: counted together, fewer of one would hide more of the other. Groups pool the
    scenarios.

    Args:
        held_out: The held-out tests of all versions, n each.
        groups: Named groups, name -> (n,) bool.

    Returns:
        The parts that have tests.
    """
    calm = np.isin([test.scenario for test in held_out.tests], held_out.no_braking)
    measures: dict[Measure, Bools] = {"failures": ~calm, "false activations": calm}
    places = {held_out.labels[name]: rows for name, rows in held_out.scenarios.items()}
    parts = []
    for measure, counted in measures.items():
        for name, rows in [*places.items(), *groups.items()]:
            parts.append(Part(name, measure, rows & counted))
    return [part for part in parts if part.rows.any()]


def gate_reason(
    judged: Gate, base: VersionResult, version: VersionResult, over_seeds: GroupPair, policy: Policy
) -> str:
    """Why the gate passes a version or holds it back, in words.

    Args:
        judged: Outcome of the gate for the version.
        base: Result of the base.
        version: Result of the version.
        over_seeds: The version's group against the base.
        policy: Conditions of the gate.

    Returns:
        The first condition that fails, in the order of `Gate`. If the version passes, the parts
        that are too small to judge are listed, because they show nothing.
    """
    p_value = 1.0 if version.paired is None else version.paired.p_value
    margin = f"{100 * policy.margin * base.rate:.3g} points"
    if judged.more_errors:
        return f"held back: {version.errors} errors, {base.errors} with {base.version}"
    if not judged.fewer:
        how_many = "significantly more" if version.verdict == "worse" else "not significantly fewer"
        return f"held back: {how_many} failures than {base.version} (p = {p_value:.2g})"
    if not judged.fewer_over_seeds:
        mean = over_seeds.difference
        interval = f"{mean.value:+.1f}, {mean.low:+.1f} to {mean.high:+.1f}"
        return (
            f"held back: over all its seeds, {version.group} does not show fewer failures than "
            f"{base.version} ({interval}; p = {over_seeds.p_value:.2g})"
        )
    if worse := judged.limits_that_are("significantly worse"):
        parts = ", ".join(f"{_printed(limit)} (p = {limit.p_value:.2g})" for limit in worse)
        return f"held back: significantly worse in {parts}"
    if above := judged.limits_that_are("above the margin"):
        return f"held back: {_rises(above)}, more than the margin of {margin}"
    reason = f"passes: significantly fewer failures than {base.version} (p = {p_value:.2g})"
    if within := {limit.measure for limit in judged.limits_that_are("within the margin")}:
        level = f"{100 * policy.confidence:g} % upper limits"
        rates = " and ".join(rate for measure, rate in RATES.items() if measure in within)
        rise = "rises" if len(within) == 1 else "rise"
        where = "in each judged scenario and group"
        reason += f"; {rates} {rise} by at most {margin} {where} ({level})"
    small = [_printed(limit) for limit in judged.limits_that_are("too small to judge")]
    return f"{reason}; too small to judge: {', '.join(small)}" if small else reason


def _printed(limit: RiseLimit) -> str:
    """`children`, or `false activations in children`."""
    return limit.name if limit.measure == "failures" else f"{limit.measure} in {limit.name}"


def _rises(limits: Sequence[RiseLimit]) -> str:
    """`the failure rate may rise by up to 14.0 points (F2*), 12.3 points (children)`.

    Likewise for false activations.
    """
    clauses = []
    for measure, rate in RATES.items():
        chosen = [limit for limit in limits if limit.measure == measure]
        points = ", ".join(f"{100 * limit.limit:.1f} points ({limit.name})" for limit in chosen)
        if chosen:
            clauses.append(f"{rate} may rise by up to {points}")
    return " and ".join(clauses)
