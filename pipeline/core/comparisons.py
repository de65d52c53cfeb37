"""Comparisons of a variable with a number or with another variable, decided by categories and not by single values."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import pairwise, product
from math import prod

from pipeline.core.expressions import MOST_ROWS, OneOf
from pipeline.core.variable import Variable, number_text

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,4})?", re.ASCII)
"""The text of a number in a table, a model or a constraint."""
SIGNS: dict[str, Callable[[int, int], bool]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
SIBLING = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
"""The sign that differs at one value only."""


@dataclass(frozen=True)
class Span:
    """The numbers from `low` to `high`; `high` itself only if `closed`. A single number is closed."""

    low: Decimal
    high: Decimal
    closed: bool = True

    def has(self, number: Decimal) -> bool:
        return self.low <= number < self.high or (self.closed and number == self.high)


Spans = tuple[Span, ...]
"""The numbers of one category: one span, or two for the part of a cyclic variable that contains its ends."""


def number(text: str) -> Decimal | None:
    """The number that a text writes, exactly; None if it writes none."""
    return Decimal(text) if NUMBER.fullmatch(text) else None


def is_numeric(variable: Variable) -> bool:
    """Whether every category of a variable stands for numbers."""
    return variable.kind != "categorical" or all(map(NUMBER.fullmatch, variable.values))


def compare_with_number(
    variables: Sequence[Variable], index: int, sign: str, constant: Decimal
) -> OneOf:
    """The categories of a variable in which every value compares to the constant.

    Raises ValueError if the values are no numbers, and if a category has both values that do and values that do not.
    """
    variable, spans = variables[index], (Span(constant, constant),)
    results = [_decided(own, spans, sign) for own in _numbers(variable)]
    if None in results:
        raise ValueError(_undecided(variable, sign, constant, variable.labels[results.index(None)]))
    return OneOf(
        (index,), frozenset((category,) for category, holds in enumerate(results) if holds)
    )


def compare_variables(variables: Sequence[Variable], first: int, sign: str, second: int) -> OneOf:
    """The pairs of categories of two variables in which every pair of values compares so.

    Variables compare as numbers if both are numeric; else = and != compare the names of their categories.

    Raises ValueError for variables that cannot be compared, pairs of categories that do not decide it, and too many pairs.
    """
    one, two = variables[first], variables[second]
    what = f"{one.name} {sign} {two.name}"
    if first == second:
        raise ValueError(f"{what} compares a variable with itself")
    if (count := prod((one.size, two.size))) > MOST_ROWS:
        raise ValueError(f"{what} compares {count:,} pairs of categories, more than {MOST_ROWS:,}")
    if sign in ("=", "!=") and not (is_numeric(one) and is_numeric(two)):
        return OneOf((first, second), _named_alike(one, sign, two))
    pairs = product(enumerate(_numbers(one)), enumerate(_numbers(two)))
    results = {(a, b): _decided(own, other, sign) for (a, own), (b, other) in pairs}
    for (a, b), holds in results.items():
        if holds is None:
            raise ValueError(
                f"{what} holds for some values of the categories {one.labels[a]} and {two.labels[b]}, and not for others; "
                "name the categories, or choose cuts at which they do not overlap"
            )
    return OneOf((first, second), frozenset(pair for pair, holds in results.items() if holds))


def _named_alike(one: Variable, sign: str, two: Variable) -> frozenset[tuple[int, ...]]:
    common = set(one.labels) & set(two.labels)
    if not common:
        raise ValueError(
            f"{one.name} {sign} {two.name} compares variables that have no category in common"
        )
    pairs = product(enumerate(one.labels), enumerate(two.labels))
    return frozenset((a, b) for (a, own), (b, other) in pairs if (own == other) == (sign == "="))


def _numbers(variable: Variable) -> tuple[Spans, ...]:
    """The numbers of each category. A category of a step stands for its multiple, to which its values are nearest."""
    if variable.kind == "categorical" and not is_numeric(variable):
        other = next(value for value in variable.values if not NUMBER.fullmatch(value))
        raise ValueError(
            f"only numbers compare by <, <=, > and >=, and a category of {variable.name} is {other!r}; use = or in {{…}}"
        )
    if variable.cuts is None:
        return tuple((Span(exact, exact),) for exact in map(Decimal, variable.labels))
    ends = list(map(Decimal, map(number_text, (variable.low, *variable.cuts, variable.high))))
    parts = [Span(low, high, closed=high == ends[-1]) for low, high in pairwise(ends)]
    if variable.cyclic and variable.cuts:
        return *((part,) for part in parts[1:-1]), (parts[-1], parts[0])
    return tuple((part,) for part in parts)


def _decided(first: Spans, second: Spans, sign: str) -> bool | None:
    """Whether every two of the numbers compare so; None if some do and some do not."""
    found = {SIGNS[sign](order, 0) for a, b in product(first, second) for order in _orders(a, b)}
    return found.pop() if len(found) == 1 else None


def _orders(first: Span, second: Span) -> set[int]:
    """How numbers of two spans can compare: -1 the first is smaller, 0 they are equal, 1 it is larger."""
    start = max(first.low, second.low)
    possible = {
        -1: first.low < second.high,
        0: first.has(start) and second.has(start),
        1: second.low < first.high,
    }
    return {order for order, may_be in possible.items() if may_be}


def _undecided(variable: Variable, sign: str, constant: Decimal, label: str) -> str:
    what = f"{variable.name} {sign} {constant} holds for some values of the category {label}, and not for others"
    spans = (Span(constant, constant),)
    if sign in SIBLING and all(
        _decided(own, spans, SIBLING[sign]) is not None for own in _numbers(variable)
    ):
        return f"{what}; write {SIBLING[sign]} {constant}, or choose other cuts"
    ends = ", ".join(map(number_text, variable.cuts or ()))
    return (
        f"{what}; compare with a cut ({ends}), or name the category"
        if ends
        else f"{what}, and it has no cuts"
    )
