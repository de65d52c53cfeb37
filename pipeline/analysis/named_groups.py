"""Named groups of tests, such as `children` or `night`; the gate judges each of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.core.comparison import Bools
from pipeline.core.space import Floats, Space
from pipeline.scenarios import people

MOST_VALUES = 12
"""A variable with more values, such as the 74 people, would give groups of too few tests."""
WEATHER: dict[str, tuple[str, Callable[[Floats], Bools]]] = {
    "night": ("sun_altitude", lambda altitude_deg: altitude_deg < 0),
    "rain": ("rain", lambda percent: percent >= 50),
}
"""Name -> variable and condition on its values, (n,)."""


def named_groups(space: Space, points: Floats) -> dict[str, Bools]:
    """The groups of points; a point may belong to several.

    Each value of a categorical variable with at most `MOST_VALUES` values is a group, such as
    `animation = crouching`. Further groups, if the space has their variables: `children` and
    `adults`, `night` (sun below the horizon), `rain` (50 % or more).

    Args:
        space: The scenario space.
        points: Encoded points, (n, d).

    Returns:
        Name -> (n,) bool.
    """
    columns = dict(zip(space.names, points.T, strict=True))
    groups: dict[str, Bools] = {}
    for variable in space.variables:
        if variable.kind == "categorical" and variable.size <= MOST_VALUES:
            for index, value in enumerate(variable.values):
                groups[f"{variable.name} = {value}"] = columns[variable.name] == index
    if people.VARIABLE in columns:
        names = space.variables[space.names.index(people.VARIABLE)].values
        children = np.array([people.person(name).child for name in names])
        groups["children"] = children[columns[people.VARIABLE].astype(np.int64)]
        groups["adults"] = ~groups["children"]
    for name, (of_variable, holds) in WEATHER.items():
        if of_variable in columns:
            groups[name] = holds(columns[of_variable])
    return groups
