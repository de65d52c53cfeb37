"""Tags of ASAM OpenLABEL 1.0 files as points.

A point is a file, or each stretch of its frames with the same tags.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.artefacts.data_set import DataSet, member
from pipeline.core.space import Variable
from pipeline.core.variable import number_text
from pipeline.errors import InputError, shown

ROOT = "openlabel"
VERSION = "1."
ELEMENTS = {"tags": "tag_data", "contexts": "context_data"}
"""The elements that are read, and where their data is."""
Interval = tuple[int, int]
"""The first and the last frame."""


@dataclass(frozen=True)
class Tagged:
    """A value of a variable, and the frames in which it holds; without intervals, in all."""

    variable: Variable
    value: str
    intervals: tuple[Interval, ...]

    def holds(self, frame: int) -> bool:
        return not self.intervals or any(first <= frame <= last for first, last in self.intervals)


def is_openlabel(plain: Any) -> bool:
    """Whether JSON is an OpenLABEL file."""
    return isinstance(plain, dict) and ROOT in plain


def openlabel(files: Sequence[tuple[Path, Any]], variables: Sequence[Variable]) -> DataSet:
    """The points of OpenLABEL files.

    A tag, or a named entry of its data, whose name is that of a variable gives its value; without
    data it means `true`. A tag whose type is a category of one variable gives that category. An
    absent tag says nothing. Several values, and a range that is in no single category, leave the
    variable unknown.

    Raises:
        InputError: naming the file and the place in it.
    """
    rows = [row for path, plain in files for row in _points(path, plain, variables)]
    return DataSet.of(files[0][0] if len(files) == 1 else files[0][0].parent, rows)


def _points(
    path: Path, plain: Any, variables: Sequence[Variable]
) -> list[tuple[str, dict[str, Any]]]:
    root = member(path, plain, ROOT, dict)
    version = member(
        path, member(path, root, "metadata", dict, ROOT), "schema_version", str, f"{ROOT}.metadata"
    )
    if not version.startswith(VERSION):
        raise InputError(
            f"{path}: {ROOT}.metadata.schema_version: expected {VERSION}x, got {version}"
        )
    tags = [tag for kind in ELEMENTS for tag in _elements(path, root, kind, variables)]
    whole = _intervals(path, root, ROOT)
    if not any(tag.intervals for tag in tags):
        return [(path.name, _together(tags, variables))]
    points: list[tuple[str, dict[str, Any]]] = []
    stretches: list[Interval] = []
    for first, last in _stretches([tag.intervals for tag in tags], whole):
        values = _together([tag for tag in tags if tag.holds(first)], variables)
        if points and points[-1][1] == values and stretches[-1][1] == first - 1:
            first, _ = stretches.pop()
            points.pop()
        stretches.append((first, last))
        points.append((f"{path.name}, frames {first} to {last}", values))
    return points


def _stretches(
    several: Sequence[tuple[Interval, ...]], whole: tuple[Interval, ...]
) -> Iterator[Interval]:
    """The parts of the whole recording, or of all intervals together, in which the same intervals
    hold.
    """
    every = [interval for intervals in (*several, whole) for interval in intervals]
    inside = whole or tuple(every)
    limits = {first for first, _ in every} | {last + 1 for _, last in every}
    for first, end in pairwise(sorted(limits)):
        if any(start <= first <= last for start, last in inside):
            yield first, end - 1


def _intervals(path: Path, element: Mapping[str, Any], where: str) -> tuple[Interval, ...]:
    intervals = []
    listed = []
    if "frame_intervals" in element:
        listed = member(path, element, "frame_intervals", list, where)
    for index, interval in enumerate(listed):
        place = f"{where}.frame_intervals[{index}]"
        first, last = (
            member(path, interval, key, int, place) for key in ("frame_start", "frame_end")
        )
        if first > last:
            raise InputError(
                f"{path}: {place}: expected frame_start before frame_end, got {first} and {last}"
            )
        intervals.append((first, last))
    return tuple(intervals)


def _elements(
    path: Path, root: Mapping[str, Any], kind: str, variables: Sequence[Variable]
) -> Iterator[Tagged]:
    ontologies = member(path, root, "ontologies", dict, ROOT) if "ontologies" in root else {}
    for uid, element in (member(path, root, kind, dict, ROOT) if kind in root else {}).items():
        where = f"{ROOT}.{kind}.{uid}"
        name = member(path, element, "type", str, where)
        if "ontology_uid" in element and str(element["ontology_uid"]) not in ontologies:
            raise InputError(
                f"{path}: {where}.ontology_uid: expected one of {', '.join(ontologies)}, got "
                f"{shown(element['ontology_uid'])}"
            )
        data = element.get(ELEMENTS[kind], {})
        if kind == "tags" and isinstance(data, str):
            # The schema allows a text instead of named data.
            data = {"text": [{"name": name, "val": data}]}
        elif ELEMENTS[kind] in element:
            data = member(path, element, ELEMENTS[kind], dict, where)
        intervals = _intervals(path, element, where)
        for variable, value in _values(path, f"{where}.{ELEMENTS[kind]}", name, data, variables):
            yield Tagged(variable, value, intervals)


def _values(
    path: Path, where: str, name: str, data: Any, variables: Sequence[Variable]
) -> Iterator[tuple[Variable, str]]:
    """What one tag says of the variables."""
    named = {variable.name: variable for variable in variables}
    entries = list(_entries(path, where, data))
    for key in dict.fromkeys(entry.get("name", name) for _, _, entry in entries):
        if key in named:
            values = [entry for entry in entries if entry[2].get("name", name) == key]
            yield named[key], _value(path, named[key], values)
    if not entries and name in named and "true" in named[name].labels:
        yield named[name], "true"
    classes = [
        variable
        for variable in variables
        if variable.kind == "categorical" and name in variable.values
    ]
    if len(classes) > 1:
        both = " and of ".join(variable.name for variable in classes)
        raise InputError(
            f"{path}: {where.rpartition('.')[0]}: {name} is a category of {both}; give them "
            "different names"
        )
    denied = any(kind == "boolean" and entry.get("val") is False for _, kind, entry in entries)
    if classes and name not in named and not denied:
        yield classes[0], name


def _entries(path: Path, where: str, data: Any) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Place, kind and content of each entry of a tag's data."""
    for kind in ("boolean", "num", "text", "vec"):
        listed = member(path, data, kind, list, where) if kind in data else []
        for index, entry in enumerate(listed):
            place = f"{where}.{kind}[{index}]"
            if not isinstance(entry, dict) or "val" not in entry:
                raise InputError(
                    f"{path}: {place}: expected a mapping with val, got {shown(entry)}"
                )
            if not isinstance(entry.get("name", ""), str):
                raise InputError(
                    f"{path}: {place}.name: expected a text, got {shown(entry['name'])}"
                )
            yield place, kind, entry


def _value(
    path: Path, variable: Variable, entries: Sequence[tuple[str, str, Mapping[str, Any]]]
) -> str:
    """The value of a variable as text.

    Several values are joined, which is no category, so the variable is unknown.
    """
    texts: dict[str, None] = {}
    low, high = -np.inf, np.inf
    for place, kind, entry in entries:
        value, sort = entry["val"], entry.get("type", "value")
        if kind == "boolean" and isinstance(value, bool):
            texts[str(value).lower()] = None
        elif kind == "text" and isinstance(value, str):
            texts[value] = None
        elif kind == "num" and sort == "min":
            low = _number(path, place, value)
        elif kind == "num" and sort == "max":
            high = _number(path, place, value)
        elif kind == "num":
            texts[number_text(_number(path, place, value))] = None
        elif kind == "vec" and isinstance(value, list) and value and sort == "range":
            low, high = (_number(path, place, end) for end in (value[0], value[-1]))
        elif kind == "vec" and isinstance(value, list) and value:
            for item in value:
                text = item if isinstance(item, str) else number_text(_number(path, place, item))
                texts[text] = None
        else:
            expected = {"boolean": "true or false", "text": "a text"}.get(kind, "a list of values")
            raise InputError(f"{path}: {place}.val: expected {expected}, got {shown(value)}")
    if (low, high) != (-np.inf, np.inf):
        texts[_range(variable, float(low), float(high))] = None
    return " and ".join(texts)


def _range(variable: Variable, low: float, high: float) -> str:
    """A number in the category that holds a whole range, else the range."""
    if variable.kind != "categorical" and not variable.cyclic and low <= high:
        ends = np.clip([low, high], variable.low, variable.high)
        starts_inside = variable.low <= low or not isfinite(low)
        ends_inside = high <= variable.high or not isfinite(high)
        same = len(set(variable.categorise(ends).tolist())) == 1
        if starts_inside and ends_inside and same:
            return number_text(float(ends[0]))
    return f"{number_text(low)} to {number_text(high)}"


def _number(path: Path, place: str, value: Any) -> float:
    try:
        number = float(value) if not isinstance(value, bool) else np.nan
    except (TypeError, ValueError, OverflowError):
        number = np.nan
    if not isfinite(number):
        raise InputError(f"{path}: {place}.val: expected a number, got {shown(value)}")
    return number


def _together(tags: Sequence[Tagged], variables: Sequence[Variable]) -> dict[str, Any]:
    """One value a variable: None without a tag, all of them joined if they differ."""
    conditions: dict[str, Any] = {}
    for variable in variables:
        values = dict.fromkeys(tag.value for tag in tags if tag.variable is variable)
        conditions[variable.name] = " and ".join(values) if values else None
    return conditions
