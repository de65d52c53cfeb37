"""A readable rule for a failure region: a few intervals and value sets that contain its failures and few other tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.space import Floats, Space, Variable

Bools = NDArray[np.bool_]
EVERY = "every test"
"""The text of a rule without conditions."""
MAX_CONDITIONS = 4
TRIM = 0.05
"""Share of a region's failures that a condition may leave out at either end."""
MIN_GAIN = 0.02
"""Smallest gain in precision per condition; a value set must gain it once per value, because long lists fit any failures."""
TELLING = 0.5
"""A value set is informative if it names at most this share of the values that equally many random tests would have."""
NARROW = 0.85
"""An interval is informative if its width is at most this share of that of equally many random tests."""


@dataclass(frozen=True)
class Condition:
    """One variable's part of a rule. A cyclic interval with low > high wraps around the end of the range."""

    variable: int
    low: float = 0.0
    high: float = 0.0
    values: tuple[int, ...] = ()

    def holds(self, points: Floats) -> Bools:
        """Which points (n, d) it admits, as (n,)."""
        column = points[:, self.variable]
        if self.values:
            return np.isin(column, self.values)
        if self.low <= self.high:
            return (column >= self.low) & (column <= self.high)
        return (column >= self.low) | (column <= self.high)


@dataclass(frozen=True)
class Rule:
    """A conjunction of conditions; without conditions it holds for every test."""

    conditions: tuple[Condition, ...]

    def holds(self, points: Floats) -> Bools:
        """Which points (n, d) it admits, as (n,)."""
        result = np.ones(len(points), bool)
        for condition in self.conditions:
            result &= condition.holds(points)
        return result

    def text(self, space: Space) -> str:
        """As a person reads it: `fog >= 60 % and sun_altitude in [-20, 3] deg`."""
        return " and ".join(_condition_text(c, space.variables[c.variable]) for c in self.conditions) or EVERY


def find_rule(space: Space, points: Floats, failures: Bools, members: Bools) -> Rule:
    """Find the rule of a region.

    points: (n, d), all tests. failures: (n,). members: (n,), the failures that form the region. Greedy: among the conditions that the
    members satisfy, add the one that raises the precision (share of failures among the tests inside) most beyond its price, while there is
    one.
    """
    if not members.any() or (members & ~failures).any():
        raise ValueError("a region needs members, and all of them must be failures")
    chosen: list[Condition] = []
    left = [c for j, v in enumerate(space.variables) if (c := _condition(j, v, points[members])) is not None]
    precision = failures.mean()
    while left and len(chosen) < MAX_CONDITIONS:
        scores = [_precision(Rule((*chosen, c)), points, failures) for c in left]
        surplus = [score - precision - MIN_GAIN * max(1, len(c.values)) for score, c in zip(scores, left, strict=True)]
        best = int(np.argmax(surplus))
        if surplus[best] < 0:
            break
        precision = scores[best]
        chosen.append(left.pop(best))
    return Rule(tuple(sorted(chosen, key=lambda c: c.variable)))


def _precision(rule: Rule, points: Floats, failures: Bools) -> float:
    inside = rule.holds(points)
    return float(failures[inside].mean()) if inside.any() else 0.0


def _condition(index: int, variable: Variable, members: Floats) -> Condition | None:
    """The narrowest condition on one variable that (nearly) all members satisfy; None if it is not informative."""
    column = members[:, index]
    if variable.kind == "categorical":
        values = tuple(int(v) for v in np.unique(column))
        by_chance = variable.size * (1 - (1 - 1 / variable.size) ** len(column))
        return Condition(index, values=values) if len(values) <= TELLING * by_chance else None
    if variable.cyclic:
        return _arc(index, variable, column)
    low, high = np.quantile(column, [TRIM, 1 - TRIM]) if len(column) >= 1 / TRIM else (column.min(), column.max())
    low, high = _outward(variable, float(low), float(high))
    by_chance = (variable.high - variable.low) * (len(column) - 1) / (len(column) + 1)
    return None if high - low > NARROW * by_chance else Condition(index, low, high)


def _outward(variable: Variable, low: float, high: float) -> tuple[float, float]:
    """Round the bounds outwards to half a step, so that rules are easy to read, and keep them in the range."""
    unit = variable.rounding
    down, up = np.floor((low - variable.low) / unit) * unit, np.ceil((high - variable.low) / unit) * unit
    return max(variable.low, variable.low + float(down)), min(variable.high, variable.low + float(up))


def _arc(index: int, variable: Variable, column: Floats) -> Condition | None:
    """The shortest arc that contains all members: the circle without its widest gap."""
    period = variable.high - variable.low
    ordered = np.sort(column)
    gaps = np.diff(ordered, append=ordered[0] + period)
    widest = int(np.argmax(gaps))
    if gaps[widest] < 0.25 * period:
        return None
    unit = variable.rounding
    low = float(np.floor((ordered[(widest + 1) % len(ordered)] - variable.low) / unit) * unit + variable.low)
    high = float(np.ceil((ordered[widest] - variable.low) / unit) * unit + variable.low)
    return Condition(index, low, min(high, variable.high))


def _condition_text(condition: Condition, variable: Variable) -> str:
    unit = f" {variable.unit}" if variable.unit else ""
    if condition.values:
        names = [variable.values[i] for i in condition.values]
        return f"{variable.name} = {names[0]}" if len(names) == 1 else f"{variable.name} in {{{', '.join(names)}}}"
    if condition.low > condition.high:
        return f"{variable.name} from {condition.low:g} through {variable.high:g} to {condition.high:g}{unit}"
    if condition.low <= variable.low:
        return f"{variable.name} <= {condition.high:g}{unit}"
    if condition.high >= variable.high:
        return f"{variable.name} >= {condition.low:g}{unit}"
    return f"{variable.name} in [{condition.low:g}, {condition.high:g}]{unit}"
