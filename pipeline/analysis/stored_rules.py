"""A region's rule from its conditions in the artefact."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.artefacts.region_results import RuleCondition
from pipeline.core.rules import Condition, Rule
from pipeline.core.space import Space


def stored_rule(space: Space, conditions: Sequence[RuleCondition]) -> Rule:
    """The rule that admits the same points as the one that was stored; ValueError for a variable that the space does not have."""
    return Rule(tuple(_condition(space, stored) for stored in conditions))


def _condition(space: Space, stored: RuleCondition) -> Condition:
    first, other, sign = _variables(space, stored.variable)
    if stored.low is not None and stored.high is not None:
        return Condition(first, stored.low, stored.high, other=other, sign=sign)
    return Condition(
        first, values=tuple(space.variables[first].values.index(name) for name in stored.values)
    )


def _variables(space: Space, name: str) -> tuple[int, int, int]:
    """The index of a variable; of `rain - fog`, those of both and the sign."""
    if name in space.names:
        return space.names.index(name), 0, 0
    first, sign, other = name.split(" ")
    return space.names.index(first), space.names.index(other), 1 if sign == "+" else -1
