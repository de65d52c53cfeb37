"""Moves the alias `champion` after a comparison: only to a version that was compared with the holder and is better."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.artefacts.comparison_results import Comparison
from pipeline.tracking.contents import WEIGHTS
from pipeline.tracking.registry import Registry

CHAMPION = "champion"


def successor(comparison: Comparison, holder: str | None) -> tuple[str | None, str]:
    """The version that takes the alias, or None if the alias stays; and the reason.

    holder: the version of the comparison that has the alias, None if the holder did not execute these tests. It loses the alias only to the
    comparison's champion, the best version that passes the gate or else the base, and only if that fails significantly less. A holder that
    the gate holds back keeps the alias otherwise: not having shown to be better than the base is no proof of being worse.
    """
    best, base = comparison.champion, comparison.versions[0].version
    if holder is None:
        return (
            None,
            "champion stays with a version that did not execute these tests; to compare with it, set base.weights to its folder",
        )
    if holder == best:
        return None, f"champion stays with {holder}"
    if fails_less(comparison, best, holder):
        return best, f"champion moves from {holder} to {best}, which fails significantly less"
    found = (
        ""
        if holder == base or comparison.passes(holder)
        else f" ({holder} is {comparison.gate[holder]})"
    )
    return (
        None,
        f"champion stays with {holder}: {best} does not fail significantly less than it{found}",
    )


def fails_less(comparison: Comparison, version: str, other: str) -> bool:
    """Whether a version fails significantly less than another (exact McNemar test); ValueError if they were not compared."""
    if (pair := comparison.pair(version, other)) is not None:
        return pair.verdict(comparison.alpha) == "better"
    if (pair := comparison.pair(other, version)) is not None:
        return pair.verdict(comparison.alpha) == "worse"
    raise ValueError(f"expected both {version} and {other} in the comparison")


def point_champion(
    registry: Registry,
    model: str,
    compared: Comparison,
    numbers: Mapping[str, str],
    weights: Mapping[str, str],
) -> str:
    """Update the alias `champion` after the comparison and return a sentence about it.

    numbers, weights: number of the registered version, and SHA-256 of the weights, of each version. A holder from another study counts as
    one of these versions if their weights are equal: the shipped detector is every study's base.
    """
    number = registry.aliases(model).get(CHAMPION)
    if number is None:
        registry.set_alias(model, CHAMPION, numbers[compared.champion])
        return f"the first champion is the version {compared.champion}"
    own = registry.run_tags(model, number).get(WEIGHTS)
    same = [version for version in weights if numbers[version] == number] or [
        v for v, digest in weights.items() if digest == own
    ]
    version, why = successor(compared, same[0] if same else None)
    if version is not None:
        registry.set_alias(model, CHAMPION, numbers[version])
    return why
