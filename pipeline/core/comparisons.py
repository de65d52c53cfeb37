"""Comparisons of a variable with a number or with another variable.

Categories decide them, not single values.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import pairwise, product

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
    """The numbers from `low` to `high`; `high` itself only if `closed`, as for a single number."""

    low: Decimal
    high: Decimal
    closed: bool = True

    def has(self, number: Decimal) -> bool:
        return self.low <= number < self.high or (self.closed and number == self.high)


Spans = tuple[Span, ...]
"""The numbers of a category: a span, or two for the part with the ends of a cyclic variable."""


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

    Raises:
        ValueError: the values are no numbers, or some values of a category compare so and others
            do not.
    """
    variable, constant_span = variables[index], (Span(constant, constant),)
    results = [_decided(spans, constant_span, sign) for spans in _numbers(variable)]
    if None in results:
        raise ValueError(_undecided(variable, sign, constant, variable.labels[results.index(None)]))
    rows = ((category,) for category, holds in enumerate(results) if holds)
    return OneOf((index,), frozenset(rows))


def compare_variables(variables: Sequence[Variable], first: int, sign: str, second: int) -> OneOf:
    """The pairs of categories of two variables in which every pair of values compares so.

    Variables compare as numbers if both are numeric; else = and != compare the names of their
    categories.

    Raises:
        ValueError: the variables cannot be compared, a pair of categories does not decide it, or
            there are too many pairs.
    """
    left, right = variables[first], variables[second]
    text = f"{left.name} {sign} {right.name}"
    if first == second:
        raise ValueError(f"{text} compares a variable with itself")
    if (count := left.size * right.size) > MOST_ROWS:
        raise ValueError(f"{text} compares {count:,} pairs of categories, more than {MOST_ROWS:,}")
    pairs = product(range(left.size), range(right.size))
    if sign in ("=", "!=") and not (is_numeric(left) and is_numeric(right)):
        if set(left.labels).isdisjoint(right.labels):
            raise ValueError(f"{text} compares variables that have no category in common")
        equal = sign == "="
        rows = [(a, b) for a, b in pairs if (left.labels[a] == right.labels[b]) == equal]
        return OneOf((first, second), frozenset(rows))
    left_spans, right_spans = _numbers(left), _numbers(right)
    rows = []
    for a, b in pairs:
        holds = _decided(left_spans[a], right_spans[b], sign)
        if holds is None:
            raise ValueError(
                f"{text} holds for some values of the categories {left.labels[a]} and "
                f"{right.labels[b]}, and not for others; name the categories, or choose cuts at "
                "which they do not overlap"
            )
        if holds:
            rows.append((a, b))
    return OneOf((first, second), frozenset(rows))


def _numbers(variable: Variable) -> tuple[Spans, ...]:
    """The numbers of each category; a category of a step stands for its grid value alone."""
    if not is_numeric(variable):
        other = next(value for value in variable.values if not NUMBER.fullmatch(value))
        raise ValueError(
            f"only numbers compare by <, <=, > and >=, and a category of {variable.name} is "
            f"{other!r}; use = or in {{…}}"
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
    results = set()
    for a, b in product(first, second):
        start = max(a.low, b.low)
        if a.low < b.high:
            results.add(SIGNS[sign](-1, 0))
        if a.has(start) and b.has(start):
            results.add(SIGNS[sign](0, 0))
        if b.low < a.high:
            results.add(SIGNS[sign](1, 0))
    return results.pop() if len(results) == 1 else None


def _undecided(variable: Variable, sign: str, constant: Decimal, label: str) -> str:
    """The message for a category that does not decide a comparison."""
    problem = (
        f"{variable.name} {sign} {constant} holds for some values of the category {label}, "
        "and not for others"
    )
    constant_span, sibling = (Span(constant, constant),), SIBLING.get(sign)
    if sibling is not None:
        results = [_decided(spans, constant_span, sibling) for spans in _numbers(variable)]
        if None not in results:
            return f"{problem}; write {sibling} {constant}, or choose other cuts"
    if not variable.cuts:
        return f"{problem}, and it has no cuts"
    cuts = ", ".join(map(number_text, variable.cuts))
    return f"{problem}; compare with a cut ({cuts}), or name the category"
