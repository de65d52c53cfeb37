"""The categories that a table's column means, and what in it means none."""

from __future__ import annotations

import difflib
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.artefacts.space_file import MOST_CATEGORIES
from pipeline.artefacts.spelling import NUMBER, Spellings
from pipeline.core.space import Floats, Ints, Variable
from pipeline.core.variable import number_text

Column = Any
"""A chunked Arrow array of (n,) values, with null for a missing one."""


@dataclass(frozen=True)
class Fault:
    """Why rows are imperfect. text: what was expected and what came. row: the first such row, from 0. rows: their number. left_out: whether
    they break a constraint and so do not count; else they count for their other conditions."""

    text: str
    row: int
    rows: int
    left_out: bool = False


def categories_of(variable: Variable, column: Column) -> tuple[Ints, list[Fault]]:
    """Category indices of (n,) values or names of categories, -1 where there is none, and why, in the order of the rows.

    A name is what the space file writes, or the same truth value, number or time. A time in a range counts as seconds since 1970, UTC.
    """
    different, where = _different(variable, column)
    meant = _named(variable, different) if variable.kind == "categorical" else _ranged(variable, different)
    categories = np.append(meant, -1)[where]
    faults = _faults(variable, different, np.where(categories < 0, where, -1)) if (categories < 0).any() else []
    return categories, faults


def _different(variable: Variable, column: Column) -> tuple[Any, Ints]:
    """The (m,) different values of a column, as an Arrow array, and the (n,) places of its values among them; m for null."""
    kind = column.type
    if pa.types.is_dictionary(kind):
        column = column.cast(kind.value_type)
    elif pa.types.is_nested(kind) or pa.types.is_binary(kind) or pa.types.is_large_binary(kind):
        raise ValueError(f"{variable.name}: expected texts, numbers, truth values or times, got values of type {kind}")
    elif pa.types.is_null(kind) or pa.types.is_float16(kind):
        column = column.cast(pa.string() if pa.types.is_null(kind) else pa.float32())
    chunks = column.dictionary_encode().unify_dictionaries().chunks
    different = chunks[0].dictionary if chunks else pa.array([], column.type)
    places = [chunk.indices.fill_null(len(different)).to_numpy(zero_copy_only=False) for chunk in chunks]
    return different, np.concatenate([np.zeros(0, np.int64), *places]).astype(np.int64)


def _named(variable: Variable, different: Any) -> Ints:
    names = Spellings(variable.values)
    return np.array([-1 if value != value else names.find(str(value)) for value in _values(different)], np.int64)


def _values(different: Any) -> list[Any]:
    """Python's values; a number of single precision as it is written, not as its double."""
    single = pa.types.is_float32(different.type)
    return list(map(float, map(str, different.to_numpy()))) if single else list(different.to_pylist())


def _ranged(variable: Variable, different: Any) -> Ints:
    numbers, names = _numbers(different), {label: index for index, label in enumerate(variable.labels)}
    inside = (numbers >= variable.low) & (numbers <= variable.high)
    categories = np.full(len(numbers), -1)
    categories[inside] = variable.categorise(numbers[inside])
    for place in np.flatnonzero(np.isnan(numbers)):
        categories[place] = names.get(str(different[int(place)].as_py()).strip(), -1)
    return categories


def _numbers(different: Any) -> Floats:
    """Values as numbers, nan for what is none."""
    kind = different.type
    if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
        microseconds = different.cast(pa.timestamp("us"), safe=False).cast(pa.int64())
        return np.asarray(microseconds.to_numpy(zero_copy_only=False) / 1e6)
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        return np.asarray(different.to_numpy(zero_copy_only=False), float)
    numbers = np.full(len(different), np.nan)
    if not pa.types.is_boolean(kind):
        for place, text in enumerate(map(str, different.to_pylist())):
            with suppress(ValueError):
                numbers[place] = float(text) if text.isascii() and "_" not in text else np.nan
    return numbers


def _faults(variable: Variable, different: Any, wrong: Ints) -> list[Fault]:
    """wrong: (n,) places among the different values of those that have no category, -1 for a value with one."""
    rows = np.flatnonzero(wrong >= 0)
    places, first, counts = np.unique(wrong[rows], return_index=True, return_counts=True)
    missing = np.array([place == len(different) or _is_nan(different[int(place)].as_py()) for place in places])
    faults = []
    if missing.any():
        faults.append(
            Fault(
                f"{variable.name} must be {_expected(variable)}, got nothing", int(rows[first[missing].min()]), int(counts[missing].sum())
            )
        )
    if len(unknown := np.flatnonzero(~missing)) > MOST_CATEGORIES or variable.kind != "categorical":
        groups = [unknown] if len(unknown) else []
    else:
        groups = [unknown[i : i + 1] for i in range(len(unknown))]
    for group in groups:
        start = group[np.argmin(first[group])]
        text = _unknown(variable, different[int(places[start])].as_py(), len(group), len(different))
        faults.append(Fault(text, int(rows[first[start]]), int(counts[group].sum())))
    return sorted(faults, key=lambda fault: fault.row)


def _unknown(variable: Variable, value: Any, group: int, different: int) -> str:
    expected = _expected(variable, str(value))
    if group > MOST_CATEGORIES and variable.kind == "categorical":
        return (
            f"{variable.name} has {different:,} different values, as an identifier or a measurement has; "
            f"expected {expected}, or give it an interval with cuts"
        )
    shown = repr(value) if isinstance(value, str) and not NUMBER.fullmatch(value.strip()) else str(value)
    return f"{variable.name} must be {expected}, got {shown}" + (f" and {group - 1:,} other values" if group > 1 else "")


def _expected(variable: Variable, wrong: str = "") -> str:
    if variable.kind != "categorical":
        return f"a number in [{number_text(variable.low)}, {number_text(variable.high)}] {variable.unit}".rstrip()
    close = difflib.get_close_matches(wrong, variable.values, n=1, cutoff=0.5)
    shown = variable.values if len(variable.values) <= 12 else (*variable.values[:6], "…")
    return f"one of {', '.join(shown)}" + (f" (did you mean '{close[0]}'?)" if close else "")


def _is_nan(value: Any) -> bool:
    return bool(value != value)
