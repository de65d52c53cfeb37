"""Words for what the values of a categorical variable have in common, such as `child` for the people up to 1.4 m."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.core.space import Space


@dataclass(frozen=True)
class Word:
    """A word for the values of a variable with an attribute in [low, high], or, without an attribute, for the value `value`.

    text: as it stands in a rule. Words of one rule form a phrase in the order of their declaration, as `crouching` and `under an umbrella`.
    """

    text: str
    variable: str
    attribute: str = ""
    low: float = -np.inf
    high: float = np.inf
    value: str = ""


@dataclass(frozen=True)
class Meaning:
    """A word in one space. variable: its index. values: encoded values that the word stands for, not empty. order: in the declaration."""

    text: str
    variable: int
    values: tuple[int, ...]
    order: int


def meanings(space: Space, words: Sequence[Word]) -> tuple[Meaning, ...]:
    """The words that tell some values of a space from the others; words of variables, attributes and values that it lacks are left out."""
    found = ((word, _values(space, word)) for word in words)
    return tuple(
        Meaning(word.text, space.names.index(word.variable), values, order)
        for order, (word, values) in enumerate(found)
        if values and len(values) < space.variables[space.names.index(word.variable)].size
    )


def _values(space: Space, word: Word) -> tuple[int, ...]:
    if word.variable not in space.names:
        return ()
    variable = space.variables[space.names.index(word.variable)]
    if word.value:
        return (variable.values.index(word.value),) if word.value in variable.values else ()
    numbers = dict(variable.attributes).get(word.attribute, ())
    return tuple(i for i, number in enumerate(numbers) if word.low <= number <= word.high)
