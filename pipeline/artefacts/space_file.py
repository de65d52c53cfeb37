"""Space files: operating conditions with their weights and constraints in YAML, for the `coverage` commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pipeline.artefacts.point_table import MOST_CATEGORIES
from pipeline.core.names import nearest
from pipeline.core.space import Space, Variable
from pipeline.core.variable import HEAVIEST
from pipeline.errors import InputError

KEYS = ("values", "interval", "cuts", "cyclic", "unit", "weights")
EXAMPLE = "weather: {values: [sunny, rainy], weights: {rainy: 3}} or fog: {interval: [0, 100], cuts: [20, 50]}"


def read_space_file(path: Path) -> Space:
    """Read a space file.

    Raises InputError that names the file and the key: for a missing, wrong or unknown key, and for contradictory constraints, with as few
    clauses as contradict each other.
    """
    try:
        plain = yaml.safe_load(path.read_text())
    except OSError as error:
        raise InputError(f"{path}: expected a space file, got {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not valid YAML ({str(error).splitlines()[0]})") from error
    try:
        return _space(plain)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def _space(plain: Any) -> Space:
    if not isinstance(plain, Mapping) or not isinstance(plain.get("variables"), Mapping) or not plain["variables"]:
        raise ValueError("expected a mapping with 'variables' and perhaps 'constraints'")
    for key in plain:
        if key not in ("variables", "constraints"):
            raise ValueError(f"unknown key '{key}'{nearest(str(key), ['variables', 'constraints'])}")
    variables = tuple(_variable(str(name), body) for name, body in plain["variables"].items())
    clauses = plain.get("constraints") or []
    if not isinstance(clauses, list) or not all(isinstance(clause, list) for clause in clauses):
        raise ValueError("constraints: expected a list of clauses, each a list such as [lanes = 2, current_lane != 2]")
    return Space(variables, tuple(tuple(str(literal) for literal in clause) for clause in clauses))


def _variable(name: str, body: Any) -> Variable:
    key = f"variables.{name}"
    if not isinstance(body, Mapping):
        raise ValueError(f"{key}: expected values or an interval, as in {EXAMPLE}; got {body!r}")
    for known in body:
        if known not in KEYS:
            raise ValueError(f"unknown key '{key}.{known}'{nearest(str(known), KEYS)}")
    if ("values" in body) == ("interval" in body):
        raise ValueError(f"{key}: expected either values or an interval, as in {EXAMPLE}")
    unit, cyclic = str(body.get("unit", "")), body.get("cyclic", False)
    if "values" in body:
        if "cuts" in body or cyclic:
            raise ValueError(f"{key}: cuts and cyclic go with an interval, not with values")
        variable = Variable(name, "categorical", unit, values=_values(key, body["values"]))
    else:
        variable = _interval(name, key, body)
    return replace(variable, weights=_weights(f"{key}.weights", body.get("weights"), variable.labels))


def _interval(name: str, key: str, body: Mapping[str, Any]) -> Variable:
    interval, cuts = _numbers(f"{key}.interval", body["interval"]), _numbers(f"{key}.cuts", body.get("cuts", []))
    if len(interval) != 2 or interval[0] >= interval[1]:
        raise ValueError(f"{key}.interval: expected two numbers, the smaller first, got {body['interval']}")
    if any(a >= b for a, b in pairwise((interval[0], *cuts, interval[1]))):
        raise ValueError(f"{key}.cuts: expected rising numbers inside {list(interval)}, got {body.get('cuts')}")
    cyclic = bool(body.get("cyclic", False))
    if cyclic and len(cuts) == 1:
        raise ValueError(f"{key}.cuts: a cyclic interval needs no cut or at least two, got {body.get('cuts')}")
    return Variable(name, "continuous", str(body.get("unit", "")), interval[0], interval[1], cyclic=cyclic, cuts=cuts)


def _values(key: str, plain: Any) -> tuple[str, ...]:
    if not isinstance(plain, list) or not plain:
        raise ValueError(f"{key}.values: expected a list of names, got {plain!r}")
    values = tuple(("true" if v else "false") if isinstance(v, bool) else str(v).strip() for v in plain)
    if len(values) > MOST_CATEGORIES:
        raise ValueError(
            f"{key}.values: expected at most {MOST_CATEGORIES:,} names, got {len(values):,}; a measurement needs an interval with cuts"
        )
    if len(set(values)) != len(values):
        twice = next(value for value in values if values.count(value) > 1)
        raise ValueError(f"{key}.values: '{twice}' appears twice")
    return values


def _numbers(key: str, plain: Any) -> tuple[float, ...]:
    if not isinstance(plain, list) or not all(isinstance(v, int | float) and not isinstance(v, bool) and np.isfinite(v) for v in plain):
        raise ValueError(f"{key}: expected a list of numbers, got {plain!r}")
    return tuple(float(v) for v in plain)


def _weights(key: str, plain: Any, labels: tuple[str, ...]) -> tuple[int, ...]:
    """One weight per category, 1 by default."""
    if plain is None:
        return (1,) * len(labels)
    if isinstance(plain, list):
        if len(plain) != len(labels):
            raise ValueError(f"{key}: expected {len(labels)} numbers, one a category, got {len(plain)}")
        plain = dict(zip(labels, plain, strict=True))
    if not isinstance(plain, Mapping):
        raise ValueError(f"{key}: expected a weight for each category, got {plain!r}")
    named = {("true" if k else "false") if isinstance(k, bool) else str(k).strip(): weight for k, weight in plain.items()}
    for name, weight in named.items():
        if name not in labels:
            raise ValueError(f"{key}: there is no category '{name}'{nearest(name, labels)}")
        if not isinstance(weight, int) or isinstance(weight, bool) or not 0 <= weight <= HEAVIEST:
            raise ValueError(f"{key}.{name}: expected a whole number from 0 to {HEAVIEST}, got {weight!r}")
    return tuple(named.get(label, 1) for label in labels)
