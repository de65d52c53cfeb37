"""The keys `planes` and `combinations` of a space file.

They say what coverage wants beside every combination of any k conditions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.artefacts.written_yaml import shown, whole_number
from pipeline.core.coverage.mixed import STRONGEST, Combination, Extras, NamedPlanes
from pipeline.core.names import nearest
from pipeline.core.space import Variable
from pipeline.core.variable import HEAVIEST

PLANE = "{conditions: [weather, light, road], strength: 3}"
COMBINATION = "{of: {weather: rainy, light: night}, weight: 5}"


def read_extras(planes: Any, combinations: Any, variables: Sequence[Variable]) -> Extras:
    """Named planes and single combinations.

    Raises:
        ValueError: naming the key, what was expected and what came.
    """
    if not isinstance(planes, Mapping):
        raise ValueError(
            f"planes: expected a mapping such as visibility: {PLANE}, got {shown(planes)}"
        )
    if not isinstance(combinations, list):
        raise ValueError(
            f"combinations: expected a list of entries such as {COMBINATION}, got "
            f"{shown(combinations)}"
        )
    named = tuple(_planes(name, body, variables) for name, body in planes.items())
    by_cell: dict[tuple[tuple[int, ...], tuple[int, ...]], Combination] = {}
    for number, body in enumerate(combinations, start=1):
        combination = _combination(f"combinations[{number}]", body, variables)
        cell = (combination.variables, combination.categories)
        if cell in by_cell:
            raise ValueError(f"combinations[{number}]: {shown(body['of'])} appears twice")
        by_cell[cell] = combination
    return Extras(named, tuple(by_cell.values()))


def _planes(name: str, body: Any, variables: Sequence[Variable]) -> NamedPlanes:
    key = f"planes.{name}"
    _check_keys(key, body, ("conditions", "strength"), PLANE)
    conditions = body.get("conditions")
    if not isinstance(conditions, list) or not conditions:
        raise ValueError(
            f"{key}.conditions: expected a list of conditions, got {shown(conditions)}"
        )
    indices = [_index(f"{key}.conditions", condition, variables) for condition in conditions]
    for place, condition in enumerate(conditions):
        if condition in conditions[:place]:
            raise ValueError(f"{key}.conditions: '{condition}' appears twice")
    most = min(STRONGEST, len(indices))
    if "strength" not in body and len(indices) > STRONGEST:
        raise ValueError(
            f"{key}: expected a strength from 1 to {STRONGEST} for {len(indices)} conditions"
        )
    return NamedPlanes(
        name,
        tuple(sorted(indices)),
        whole_number(f"{key}.strength", body.get("strength", str(len(indices))), 1, most),
    )


def _combination(key: str, body: Any, variables: Sequence[Variable]) -> Combination:
    _check_keys(key, body, ("of", "weight"), COMBINATION)
    of = body.get("of")
    if not isinstance(of, Mapping) or not 1 <= len(of) <= STRONGEST:
        raise ValueError(
            f"{key}.of: expected a category for each of 1 to {STRONGEST} conditions, got "
            f"{shown(of)}"
        )
    chosen: dict[int, int] = {}
    for condition, category in of.items():
        labels = variables[variable := _index(f"{key}.of", condition, variables)].labels
        if category not in labels:
            raise ValueError(
                f"{key}.of.{condition}: there is no category "
                f"{shown(category)}{nearest(str(category), labels)}"
            )
        chosen[variable] = labels.index(category)
    rising = tuple(sorted(chosen))
    weight = whole_number(f"{key}.weight", body.get("weight", "1"), 0, HEAVIEST)
    return Combination(rising, tuple(chosen[variable] for variable in rising), weight)


def _check_keys(key: str, body: Any, keys: Sequence[str], example: str) -> None:
    if not isinstance(body, Mapping):
        raise ValueError(f"{key}: expected an entry such as {example}, got {shown(body)}")
    for name in body:
        if name not in keys:
            raise ValueError(f"unknown key '{key}.{name}'{nearest(str(name), keys)}")


def _index(key: str, condition: Any, variables: Sequence[Variable]) -> int:
    names = [variable.name for variable in variables]
    if condition not in names:
        raise ValueError(
            f"{key}: there is no condition {shown(condition)}{nearest(str(condition), names)}"
        )
    return names.index(condition)
