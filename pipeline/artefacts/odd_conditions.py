"""Which categories an expression of an OpenODD condition means.

An expression is a literal, a comparison with an ordered literal, or bounds of a number.
"""

from __future__ import annotations

from math import ceil, floor, inf
from typing import Any

from pipeline.artefacts.odd_numbers import Bounds, bounds, in_unit
from pipeline.artefacts.odd_taxonomy import Concept, literals_within
from pipeline.core.names import nearest
from pipeline.core.space import Variable
from pipeline.errors import shown


def categories_meant(concept: Concept, counted: Concept, variable: Variable, text: Any) -> set[int]:
    """Indices of the categories that one expression on a concept means.

    Args:
        counted: the concept that the variable counts: the same, or the one whose literals are
            ranges of the concept.

    Raises:
        ValueError: for an expression that means no whole categories.
    """
    if not isinstance(text, str):
        raise ValueError(f"expected an expression, got {shown(text)}")
    if not concept.is_number:
        if text in variable.values:
            return {variable.values.index(text)}
        literal = text.lstrip("<>= ")
        ordered = text[:1] in ("<", ">") and concept.ranges
        if ordered and literal in concept.literals:
            place, last = concept.literals.index(literal), len(concept.literals)
            including = text[1:2] == "="
            if text[0] == "<":
                return set(range(place + including))
            return set(range(place + 1 - including, last))
        raise ValueError(
            f"{text!r} is not a literal of {variable.name}{nearest(text, variable.values)}"
        )
    limits = bounds(text)
    if variable.kind == "categorical":
        inside = literals_within(counted, limits, concept.unit_type)
        if limits.low == limits.high and not inside:
            raise ValueError(
                f"{text} is a single number, which is no literal of {variable.name}; use a range"
            )
        return set(inside)
    limits = in_unit(limits, variable.unit, concept.unit_type)
    ends = ends_of(concept, limits)
    low, high = (ends[0] if limits.low > -inf else -inf), (ends[-1] if limits.high < inf else inf)
    if low == high:
        raise ValueError(f"{text} is a single number, which is not a category; use a range")
    starts = [variable.low, *(variable.cuts or ())]
    if not {low, high} <= {*starts, -inf, inf}:
        raise ValueError(
            f"{text} cuts through a category of {variable.name}; cut {variable.name} at its ends"
        )
    return {
        part
        for part, (start, end) in enumerate(zip(starts, [*starts[1:], inf], strict=True))
        if low <= start and end <= high
    }


def ends_of(concept: Concept, limits: Bounds) -> list[float]:
    """Where categories begin and end so that bounds hold for whole ones.

    For whole numbers, these are the first one inside and the first one after it.
    """

    def first(number: float, after: bool) -> float:
        if not concept.whole or abs(number) == inf:
            return number
        return float(floor(number) + 1 if after else ceil(number))

    return [
        end
        for end in (first(limits.low, limits.above), first(limits.high, not limits.below))
        if abs(end) < inf
    ]
