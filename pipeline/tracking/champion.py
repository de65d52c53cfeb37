"""Moves the alias `champion` after a comparison: only to a version that was compared with the current holder and is better."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.artefacts.comparison_results import Comparison
from pipeline.core.comparison import clearly_better
from pipeline.tracking.contents import WEIGHTS
from pipeline.tracking.registry import Registry

CHAMPION = "champion"


def successor(comparison: Comparison, holder: str | None) -> tuple[str | None, str]:
    """The version that takes the alias, or None if the alias stays; and the reason.

    holder: the version of the comparison that has the alias, None if the holder did not execute these tests. A holder that the gate now
    holds back loses the alias; a holder that passes, or the base, loses it to a version that fails significantly less in total and
    significantly more on no scenario.
    """
    best, base = comparison.champion, comparison.versions[0].version
    if holder is None:
        return None, "champion stays with a version that did not execute these tests; to compare with it, set base.weights to its folder"
    if holder == best:
        return None, f"champion stays with {holder}"
    if holder != base and not comparison.passes(holder):
        return best, f"champion moves to {best}, as {holder} is {comparison.gate[holder]}"
    if better(comparison, best, holder):
        return best, f"champion moves from {holder} to {best}, which fails significantly less"
    return None, f"champion stays with {holder}: {best} does not fail significantly less than it"


def better(comparison: Comparison, version: str, other: str) -> bool:
    """Whether a version fails significantly less than another in total, and significantly more on no scenario (exact McNemar tests)."""
    pair = comparison.pair(version, other)
    if pair is not None:
        fixes, regressions = pair.fixes, pair.regressions
    elif (pair := comparison.pair(other, version)) is not None:
        fixes, regressions = pair.regressions, pair.fixes
    else:
        raise ValueError(f"expected both {version} and {other} in the comparison")
    return clearly_better(fixes, regressions, pair.p_value, comparison.alpha)


def point_champion(registry: Registry, model: str, compared: Comparison, numbers: Mapping[str, str], weights: Mapping[str, str]) -> str:
    """Update the alias `champion` after the comparison and return a sentence about it.

    numbers, weights: number of the registered version, and SHA-256 of the weights, of each version. A holder from another study counts as
    one of these versions if their weights are equal: the shipped detector is every study's base.
    """
    number = registry.aliases(model).get(CHAMPION)
    if number is None:
        registry.set_alias(model, CHAMPION, numbers[compared.champion])
        return f"champion is {compared.champion}, the first"
    own = registry.tags(model, number).get(WEIGHTS)
    same = [version for version in weights if numbers[version] == number] or [v for v, digest in weights.items() if digest == own]
    version, why = successor(compared, same[0] if same else None)
    if version is not None:
        registry.set_alias(model, CHAMPION, numbers[version])
    return why
