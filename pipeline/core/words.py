"""Words for what values of a categorical variable have in common.

For example: `child` for the people up to 1.4 m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.core.space import Space


@dataclass(frozen=True)
class Word:
    """A word for values of a variable: with an attribute in [low, high], or the value `value`.

    text: as it stands in a rule. Words of a rule form a phrase in the order of their declaration,
    as `crouching` and `under an umbrella`.
    """

    text: str
    variable: str
    attribute: str = ""
    low: float = -np.inf
    high: float = np.inf
    value: str = ""


@dataclass(frozen=True)
class Meaning:
    """A word in a space.

    variable: its index. values: encoded values that the word stands for, not empty. order: of the
    word in the declaration.
    """

    text: str
    variable: int
    values: tuple[int, ...]
    order: int


def meanings(space: Space, words: Sequence[Word]) -> tuple[Meaning, ...]:
    """The words that separate some values of a variable from the others.

    Words of variables, attributes and values that the space lacks are left out.
    """
    separating = []
    for order, word in enumerate(words):
        if word.variable not in space.names:
            continue
        index = space.names.index(word.variable)
        variable = space.variables[index]
        if word.value:
            values = [i for i, value in enumerate(variable.values) if value == word.value]
        else:
            numbers = dict(variable.attributes).get(word.attribute, ())
            values = [i for i, number in enumerate(numbers) if word.low <= number <= word.high]
        if values and len(values) < variable.size:
            separating.append(Meaning(word.text, index, tuple(values), order))
    return tuple(separating)
