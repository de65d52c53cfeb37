"""A region's rule from its conditions in the artefact."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.artefacts.region_results import RuleCondition
from pipeline.core.rules import Condition, Rule
from pipeline.core.space import Space


def stored_rule(space: Space, conditions: Sequence[RuleCondition]) -> Rule:
    """The rule that admits the same points as the stored one.

    Raises:
        ValueError: The space lacks a variable of the rule.
    """
    rebuilt = []
    for stored in conditions:
        name, other, sign = stored.variable, 0, 0
        if name not in space.names:  # A sum or a difference, such as `rain - fog`.
            name, operator, other_name = name.split(" ")
            other, sign = space.names.index(other_name), 1 if operator == "+" else -1
        first = space.names.index(name)
        if stored.low is not None and stored.high is not None:
            condition = Condition(first, stored.low, stored.high, other=other, sign=sign)
        else:
            values = space.variables[first].values
            condition = Condition(first, values=tuple(map(values.index, stored.values)))
        rebuilt.append(condition)
    return Rule(tuple(rebuilt))
