"""A readable rule for a failure region: a conjunction of a few intervals, words and value sets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.space import Floats, Space, Variable

Bools = NDArray[np.bool_]
EVERY = "every test"
"""The text of a rule without conditions."""


@dataclass(frozen=True)
class Condition:
    """One part of a rule: an interval of a numeric variable, or some values of a categorical one.

    variable: index. low, high: a cyclic interval with low > high wraps around the end of the range. values: encoded. text: what the values
    have in common, such as `child` or `height_m <= 1.2`; empty if they have to be listed. order: place of a word in the phrase that the
    words of a rule form; None for all other conditions. other, sign: if sign is not 0, the interval is that of the variable plus sign times
    the other one, as `rain - fog in [-12, 12] %`.
    """

    variable: int
    low: float = 0.0
    high: float = 0.0
    values: tuple[int, ...] = ()
    text: str = ""
    order: int | None = None
    other: int = 0
    sign: int = 0

    def holds(self, points: Floats) -> Bools:
        """Which points (n, d) it admits, as (n,)."""
        return self.admits(self.column(points))

    def column(self, points: Floats) -> Floats:
        """What it is about, of points (n, d), as (n,)."""
        column = points[:, self.variable]
        return np.asarray(column + self.sign * points[:, self.other]) if self.sign else column

    def admits(self, column: Floats) -> Bools:
        """Which values (n,) of its column it admits, as (n,)."""
        if self.values:
            return np.isin(column, self.values)
        if self.low <= self.high:
            return (column >= self.low) & (column <= self.high)
        return (column >= self.low) | (column <= self.high)

    def subject(self, space: Space) -> Variable:
        """The variable that it is about; a sum or a difference is a variable, too."""
        first, second = space.variables[self.variable], space.variables[self.other]
        return combined(first, second, self.sign) if self.sign else first

    def words(self, space: Space) -> str:
        """As a person reads it: `fog >= 60 %`, `animation = crouching` or `child`."""
        variable = self.subject(space)
        if self.text:
            return self.text
        return _listed(self, variable) if self.values else _interval(self, variable)


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
        """As a person reads it: `crouching child and fog >= 60 % and sun_altitude in [-20, 3] deg`."""
        named = sorted(
            (c for c in self.conditions if c.order is not None), key=lambda c: c.order or 0
        )
        phrase = [" ".join(c.text for c in named)] if named else []
        return (
            " and ".join([*phrase, *(c.words(space) for c in self.conditions if c.order is None)])
            or EVERY
        )


def combined(first: Variable, second: Variable, sign: int) -> Variable:
    """The sum (sign 1) or the difference (sign -1) of two variables with one unit."""
    ends = (second.low, second.high) if sign > 0 else (-second.high, -second.low)
    name = f"{first.name} {'+' if sign > 0 else '-'} {second.name}"
    return Variable(
        name,
        "continuous",
        first.unit,
        first.low + ends[0],
        first.high + ends[1],
        max(first.step, second.step),
    )


def _listed(condition: Condition, variable: Variable) -> str:
    names = [variable.values[i] for i in condition.values]
    return (
        f"{variable.name} = {names[0]}"
        if len(names) == 1
        else f"{variable.name} in {{{', '.join(names)}}}"
    )


def _interval(condition: Condition, variable: Variable) -> str:
    unit = f" {variable.unit}" if variable.unit else ""
    if condition.low > condition.high:
        return f"{variable.name} from {condition.low:g} through {variable.high:g} to {condition.high:g}{unit}"
    if condition.low == condition.high:
        return f"{variable.name} = {condition.low:g}{unit}"
    if condition.low <= variable.low:
        return f"{variable.name} <= {condition.high:g}{unit}"
    if condition.high >= variable.high:
        return f"{variable.name} >= {condition.low:g}{unit}"
    return f"{variable.name} in [{condition.low:g}, {condition.high:g}]{unit}"
