"""Named groups of tests, such as `children` or `night`: the gate checks that a version gets worse in none of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.core.comparison import Bools
from pipeline.core.space import Floats, Space
from pipeline.scenarios import people

MOST_VALUES = 12
"""A categorical variable with more values, such as the 74 people, would give groups of too few tests."""
WEATHER: dict[str, tuple[str, Callable[[Floats], Bools]]] = {
    "night": ("sun_altitude", lambda altitude_deg: altitude_deg < 0),
    "rain": ("rain", lambda percent: percent >= 50),
}
"""Name -> variable and condition on its values, (n,)."""


def named_groups(space: Space, points: Floats) -> dict[str, Bools]:
    """The groups of (n, d) points: name -> (n,) bool. A point may belong to several.

    Each value of a categorical variable with at most `MOST_VALUES` values is a group, such as `animation = crouching`. If the space names
    people, `children` and `adults` are; if it has their variables, so are `night` (sun below the horizon) and `rain` (50 % or more).
    """
    columns = dict(zip(space.names, points.T, strict=True))
    groups = {
        f"{variable.name} = {value}": columns[variable.name] == index
        for variable in space.variables
        if variable.kind == "categorical" and variable.size <= MOST_VALUES
        for index, value in enumerate(variable.values)
    }
    if people.VARIABLE in columns:
        groups |= _ages(space, columns[people.VARIABLE])
    return groups | {
        name: holds(columns[variable])
        for name, (variable, holds) in WEATHER.items()
        if variable in columns
    }


def _ages(space: Space, persons: Floats) -> dict[str, Bools]:
    """Children and adults. persons: (n,) encoded values of the variable that names the person."""
    names = space.variables[space.names.index(people.VARIABLE)].values
    child = np.array([people.person(name).child for name in names])[persons.astype(np.int64)]
    return {"children": child, "adults": ~child}
