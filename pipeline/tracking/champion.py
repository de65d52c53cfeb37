"""Moves the alias `champion` after a comparison, to a version that is better than the holder."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.artefacts.comparison_results import Comparison
from pipeline.tracking.contents import WEIGHTS
from pipeline.tracking.registry import Registry

CHAMPION = "champion"


def successor(comparison: Comparison, holder: str | None) -> tuple[str | None, str]:
    """The version that takes the alias, and the reason.

    The holder loses the alias only to the comparison's champion (the best version that passes the
    gate, or else the base), and only if that fails significantly less. So a holder that the gate
    holds back may keep the alias: a missing proof that it is better is no proof that it is worse.

    Args:
        comparison: The compared versions.
        holder: The version with the alias; None if it did not execute these tests.

    Returns:
        The new holder, or None if the alias stays; and a sentence.
    """
    best, base = comparison.champion, comparison.versions[0].version
    if holder is None:
        return None, (
            "champion stays with a version that did not execute these tests; to compare with it, "
            "set base.weights to its folder"
        )
    if holder == best:
        return None, f"champion stays with {holder}"
    if fails_less(comparison, best, holder):
        return best, f"champion moves from {holder} to {best}, which fails significantly less"
    gate = f" ({holder} is {comparison.gate[holder]})"
    if holder == base or comparison.passes(holder):
        gate = ""
    reason = f"{best} does not fail significantly less than it{gate}"
    return None, f"champion stays with {holder}: {reason}"


def fails_less(comparison: Comparison, version: str, other: str) -> bool:
    """Whether a version fails significantly less than another (exact McNemar test).

    Raises:
        ValueError: The versions were not compared.
    """
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
    """Update the alias `champion` after the comparison.

    A holder from another study counts as one of these versions if their weights are equal: the
    shipped detector is every study's base.

    Args:
        registry: The registered models.
        model: Name of the registered model.
        compared: The compared versions.
        numbers: Version -> number of its registered version.
        weights: Version -> SHA-256 of its weights.

    Returns:
        A sentence about the alias.
    """
    number = registry.aliases(model).get(CHAMPION)
    if number is None:
        registry.set_alias(model, CHAMPION, numbers[compared.champion])
        return f"the first champion is the version {compared.champion}"
    digest = registry.run_tags(model, number).get(WEIGHTS)
    same = [version for version in weights if numbers[version] == number]
    same += [version for version in weights if weights[version] == digest]
    version, why = successor(compared, same[0] if same else None)
    if version is not None:
        registry.set_alias(model, CHAMPION, numbers[version])
    return why
