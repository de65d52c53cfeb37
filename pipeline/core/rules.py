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
    """A part of a rule: an interval of a numeric variable, or values of a categorical one.

    Args:
        variable: index in the space.
        low: lower bound, included. A cyclic interval with low > high passes the end of the range.
        high: upper bound, included.
        values: encoded values, for a categorical variable.
        text: what the values have in common, such as `child` or `height_m <= 1.2`; empty if they
            have to be listed.
        order: place of a word in the phrase that the words of a rule form; None for all other
            conditions.
        other: index of a second variable; only with `sign`.
        sign: if not 0, the interval is that of the variable plus sign times the other one, as
            `rain - fog in [-12, 12] %`.

    >>> condition = Condition(variable=0, low=60, high=100)
    >>> condition.holds(np.array([[50.0], [60.0]])).tolist()
    [False, True]
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
        if not self.values:
            return _interval(self, variable)
        names = [variable.values[i] for i in self.values]
        if len(names) == 1:
            return f"{variable.name} = {names[0]}"
        return f"{variable.name} in {{{', '.join(names)}}}"


@dataclass(frozen=True)
class Rule:
    """A conjunction of conditions; without conditions it holds for every test.

    >>> rule = Rule((Condition(0, 60, 100), Condition(1, values=(2,))))
    >>> rule.holds(np.array([[70.0, 2.0], [70.0, 1.0]])).tolist()
    [True, False]
    """

    conditions: tuple[Condition, ...]

    def holds(self, points: Floats) -> Bools:
        """Which points (n, d) it admits, as (n,)."""
        result = np.ones(len(points), bool)
        for condition in self.conditions:
            result &= condition.holds(points)
        return result

    def text(self, space: Space) -> str:
        """As a person reads it: `crouching child and fog >= 60 % and speed in [1, 2] m/s`."""
        words = [condition for condition in self.conditions if condition.order is not None]
        words.sort(key=lambda condition: condition.order or 0)
        parts = [" ".join(word.text for word in words)] if words else []
        for condition in self.conditions:
            if condition.order is None:
                parts.append(condition.words(space))
        return " and ".join(parts) or EVERY


def combined(first: Variable, second: Variable, sign: int) -> Variable:
    """The sum (sign 1) or the difference (sign -1) of two variables with the same unit."""
    low, high = (second.low, second.high) if sign > 0 else (-second.high, -second.low)
    name = f"{first.name} {'+' if sign > 0 else '-'} {second.name}"
    step = max(first.step, second.step)
    return Variable(name, "continuous", first.unit, first.low + low, first.high + high, step)


def _interval(condition: Condition, variable: Variable) -> str:
    name, low, high = variable.name, condition.low, condition.high
    unit = f" {variable.unit}" if variable.unit else ""
    if low > high:
        return f"{name} from {low:g} through {variable.high:g} to {high:g}{unit}"
    if low == high:
        return f"{name} = {low:g}{unit}"
    if low <= variable.low:
        return f"{name} <= {high:g}{unit}"
    if high >= variable.high:
        return f"{name} >= {low:g}{unit}"
    return f"{name} in [{low:g}, {high:g}]{unit}"
