"""Space files: operating conditions with their weights and constraints in YAML, for the `coverage`
commands.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from math import isfinite, isnan
from pathlib import Path
from typing import Any

from pipeline.artefacts import sequence_space
from pipeline.artefacts.sequence_space import read_rule
from pipeline.artefacts.space_extras import read_extras
from pipeline.artefacts.written_yaml import read_written_yaml, whole_number
from pipeline.artefacts.written_yaml import shown as _shown
from pipeline.core.names import nearest
from pipeline.core.sequences import Rule
from pipeline.core.space import Space, Variable, Written
from pipeline.core.variable import HEAVIEST, number_text
from pipeline.errors import InputError

PARTS = ("variables", "constraints", "planes", "combinations", *sequence_space.PARTS)
KEYS = ("values", "interval", "cuts", "cyclic", "unit", "weights")
EXAMPLE = (
    "weather: {values: [sunny, rainy], weights: {rainy: 3}} or "
    "fog: {interval: [0, 100], cuts: [20, 50]}"
)
CONSTRAINT = (
    "a text such as 'if fog >= 50 then lights in {on, low}' or "
    "a clause such as [lanes = 2, current_lane != 2]"
)
MOST_CATEGORIES = 5000
"""Largest number of values of one variable: more usually means an identifier, or a measurement that
needs cuts."""


def read_space_file(path: Path) -> Space:
    """Read a space file.

    Raises:
        InputError: naming the file and the key: for a missing, wrong, unknown or repeated key, and
            for contradictory constraints, with as few clauses as contradict each other.
    """
    plain = read_written_yaml(path)
    try:
        return _space(plain)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def _space(plain: Any) -> Space:
    if (
        not isinstance(plain, Mapping)
        or not isinstance(plain.get("variables"), Mapping)
        or not plain["variables"]
    ):
        raise ValueError("expected a mapping with 'variables' and perhaps 'constraints'")
    for key in plain:
        if key not in PARTS:
            raise ValueError(f"unknown key '{key}'{nearest(str(key), PARTS)}")
    frames = tuple(_variable(name, body, "frames") for name, body in _frames(plain).items())
    rules = _rules(plain["variables"], frames)
    variables = []
    for name, body in plain["variables"].items():
        if name in rules:
            labels = rules[name].labels
            weights = _weights(f"variables.{name}.weights", body.get("weights"), labels)
            variables.append(Variable(name, "categorical", values=labels, weights=weights))
        else:
            variables.append(_variable(name, body))
    extras = read_extras(plain.get("planes") or {}, plain.get("combinations") or [], variables)
    space = Space(tuple(variables), _constraints(plain.get("constraints") or []), extras)
    if "sequences" not in plain:
        return space
    return sequence_space.sequence_space(
        space, frames, rules, sequence_space.read_columns(plain["sequences"])
    )


def _frames(plain: Mapping[str, Any]) -> Mapping[str, Any]:
    """The conditions of a frame, none if points are no sequences."""
    frames = plain.get("frames") or {}
    if not isinstance(frames, Mapping):
        raise ValueError(
            f"frames: expected conditions of a frame, as in {EXAMPLE}; got {_shown(frames)}"
        )
    if frames and "sequences" not in plain:
        raise ValueError(f"frames: expected sequences, too, as in {sequence_space.EXAMPLE}")
    return frames


def _rules(variables: Mapping[str, Any], frames: tuple[Variable, ...]) -> dict[str, Rule]:
    ruled = {name: body for name, body in variables.items() if sequence_space.is_rule(body)}
    if ruled and not frames:
        raise ValueError(
            f"variables.{next(iter(ruled))}: a rule needs the conditions of a frame; there is no "
            "'frames'"
        )
    if not frames:
        return {}
    space = Space(frames)
    return {name: read_rule(f"variables.{name}", body, space) for name, body in ruled.items()}


def _constraints(plain: Any) -> tuple[Written, ...]:
    if not isinstance(plain, list):
        raise ValueError(f"constraints: expected a list, each {CONSTRAINT}, got {_shown(plain)}")
    constraints: list[Written] = []
    for constraint in plain:
        if isinstance(constraint, str):
            constraints.append(constraint)
            continue
        if not isinstance(constraint, list) or not constraint:
            raise ValueError(f"constraints: expected {CONSTRAINT}, got {_shown(constraint)}")
        for literal in constraint:
            if not isinstance(literal, str):
                raise ValueError(
                    f"constraints: expected texts such as lanes = 2, got {_shown(literal)}; put "
                    "the text in quotes"
                )
        constraints.append(tuple(constraint))
    return tuple(constraints)


def _variable(name: str, body: Any, part: str = "variables") -> Variable:
    key = f"{part}.{name}"
    if not isinstance(body, Mapping):
        raise ValueError(
            f"{key}: expected values or an interval, as in {EXAMPLE}; got {_shown(body)}"
        )
    for part_name in body:
        if part_name not in KEYS:
            raise ValueError(f"unknown key '{key}.{part_name}'{nearest(str(part_name), KEYS)}")
    if ("values" in body) == ("interval" in body):
        raise ValueError(f"{key}: expected either values or an interval, as in {EXAMPLE}")
    if "values" in body:
        if "cuts" in body or _cyclic(key, body):
            raise ValueError(f"{key}: cuts and cyclic go with an interval, not with values")
        variable = Variable(
            name, "categorical", _unit(key, body), values=_values(f"{key}.values", body["values"])
        )
    else:
        variable = _interval(name, key, body)
    return replace(
        variable, weights=_weights(f"{key}.weights", body.get("weights"), variable.labels)
    )


def _unit(key: str, body: Mapping[str, Any]) -> str:
    unit = body.get("unit") or ""
    if not isinstance(unit, str):
        raise ValueError(f"{key}.unit: expected a text, got {_shown(unit)}")
    return unit


def _interval(name: str, key: str, body: Mapping[str, Any]) -> Variable:
    interval = _numbers(f"{key}.interval", body["interval"], endless=True)
    cuts = _numbers(f"{key}.cuts", body.get("cuts") or [])
    if len(interval) != 2 or interval[0] >= interval[1]:
        raise ValueError(
            f"{key}.interval: expected two numbers, the smaller first, got "
            f"{_shown(body['interval'])}"
        )
    if any(a >= b for a, b in pairwise((interval[0], *cuts, interval[1]))):
        inside = ", ".join(map(number_text, interval))
        raise ValueError(
            f"{key}.cuts: expected rising numbers inside [{inside}], got {_shown(body['cuts'])}"
        )
    cyclic = _cyclic(key, body)
    if cyclic and not all(map(isfinite, interval)):
        raise ValueError(
            f"{key}.interval: a cyclic interval needs two finite ends, got "
            f"{_shown(body['interval'])}"
        )
    if cyclic and len(cuts) == 1:
        raise ValueError(
            f"{key}.cuts: a cyclic interval needs no cut or at least two, got "
            f"{_shown(body['cuts'])}"
        )
    return Variable(name, "continuous", _unit(key, body), *interval, cyclic=cyclic, cuts=cuts)


def _cyclic(key: str, body: Mapping[str, Any]) -> bool:
    cyclic = body.get("cyclic", "false")
    if cyclic not in ("true", "false"):
        raise ValueError(f"{key}.cyclic: expected true or false, got {_shown(cyclic)}")
    return bool(cyclic == "true")


def _values(key: str, plain: Any) -> tuple[str, ...]:
    if not isinstance(plain, list) or not plain:
        raise ValueError(f"{key}: expected a list of names, got {_shown(plain)}")
    if len(plain) > MOST_CATEGORIES:
        raise ValueError(
            f"{key}: expected at most {MOST_CATEGORIES:,} names, got {len(plain):,}; a measurement "
            "needs an interval with cuts"
        )
    seen: set[str] = set()
    for value in plain:
        if not isinstance(value, str):
            raise ValueError(f"{key}: expected names, got {_shown(value)}; put a name in quotes")
        if value in seen:
            raise ValueError(f"{key}: '{value}' appears twice")
        seen.add(value)
    return tuple(plain)


def _numbers(key: str, plain: Any, endless: bool = False) -> tuple[float, ...]:
    """endless: whether `.inf` and `-.inf` are numbers too."""
    if isinstance(plain, list) and all(isinstance(text, str) and "_" not in text for text in plain):
        with suppress(ValueError):
            numbers = tuple(
                float(text.replace(".inf", "inf") if endless else text) for text in plain
            )
            if all(isfinite(number) or (endless and not isnan(number)) for number in numbers):
                return numbers
    raise ValueError(f"{key}: expected a list of numbers, got {_shown(plain)}")


def _weights(key: str, plain: Any, labels: tuple[str, ...]) -> tuple[int, ...]:
    """One weight per category, 1 by default."""
    if plain is None:
        return (1,) * len(labels)
    if isinstance(plain, list):
        if len(plain) != len(labels):
            raise ValueError(
                f"{key}: expected {len(labels)} numbers, one a category, got {len(plain)}"
            )
        plain = dict(zip(labels, plain, strict=True))
    if not isinstance(plain, Mapping):
        raise ValueError(f"{key}: expected a weight for each category, got {_shown(plain)}")
    for name, weight in plain.items():
        if name not in labels:
            raise ValueError(f"{key}: there is no category '{name}'{nearest(str(name), labels)}")
        whole_number(f"{key}.{name}", weight, 0, HEAVIEST)
    return tuple(int(plain.get(label, 1)) for label in labels)
