"""The categories that a table's column means, batch by batch, and what in it means none."""

from __future__ import annotations

import difflib
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from heapq import nlargest
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.artefacts.space_file import MOST_CATEGORIES
from pipeline.artefacts.spelling import Spellings, time_of
from pipeline.core.comparisons import NUMBER
from pipeline.core.space import Floats, Ints, Variable
from pipeline.core.variable import number_text

Column = Any
"""A chunked Arrow array of (n,) values, with null for a missing one."""
EPOCH = datetime(1970, 1, 1)
MOST_DIFFERENT = 100_000
"""Different values of a column that are kept, at most."""
HINTED = 12
"""Most frequent wrong values that get a hint: to look for the nearest of thousands of names takes a
third of a second."""


@dataclass(frozen=True)
class Fault:
    """Why rows are imperfect.

    Attributes:
        text: what was expected and what came.
        row: the first such row, from 0.
        rows: their number.
        left_out: whether they break a constraint and so do not count; else they count for their
            other conditions.
    """

    text: str
    row: int
    rows: int
    left_out: bool = False


@dataclass
class _Rows:
    """How many rows share a fault, and the first of them."""

    first: int
    number: int = 0


@dataclass
class Meanings:
    """What the values of one variable's column mean.

    A name is what the space file writes, or the same truth value, number or time; a time in a range
    counts as seconds since 1970, UTC.
    """

    variable: Variable
    _rows: int = 0
    _missing: _Rows | None = None
    _unknown: _Rows | None = None
    _first_unknown: Any = None
    _each: dict[Any, _Rows] = field(default_factory=dict)
    """The rows of each unknown value, of `MOST_DIFFERENT` at most."""
    _category_of: dict[Any, int] = field(default_factory=dict)
    """The category of each value so far, of `MOST_DIFFERENT` at most."""

    def __post_init__(self) -> None:
        self._names = Spellings(self.variable.values)

    def categories(self, column: Column) -> Ints:
        """Category indices of the next (n,) values or names of categories, -1 where there is none.

        Raises:
            ValueError: for values of a wrong type.
        """
        different, where = _different(self.variable, column)
        meant = (
            self._named(different)
            if self.variable.kind == "categorical"
            else _ranged(self.variable, different)
        )
        categories: Ints = np.append(meant, -1)[where]
        if (categories < 0).any():
            self._note(different, np.where(categories < 0, where, -1))
        self._rows += len(where)
        return categories

    def faults(self) -> list[Fault]:
        """Why values so far have no category, in the order of the rows."""
        faults, many = [], len(self._each) > MOST_CATEGORIES
        if rows := self._missing:
            text = f"{self.variable.name} must be {_expected(self.variable)}, got nothing"
            faults.append(Fault(text, rows.first, rows.number))
        if many or (self._each and self.variable.kind != "categorical"):
            assert self._unknown is not None
            text = self._explained(self._first_unknown, len(self._each))
            faults.append(Fault(text, self._unknown.first, self._unknown.number))
        else:
            hinted = {
                self._first_unknown,
                *nlargest(HINTED, self._each, key=lambda value: self._each[value].number),
            }
            for value, rows in self._each.items():
                text = self._explained(value, 1, value in hinted)
                faults.append(Fault(text, rows.first, rows.number))
        return sorted(faults, key=lambda fault: fault.row)

    def _named(self, different: Any) -> Ints:
        """The categories that values name."""
        categories = []
        for value in _values(different):
            category = self._category_of.get(value)
            if category is None:
                category = self._names.find(str(value)) if value == value else -1
                if value == value and len(self._category_of) < MOST_DIFFERENT:
                    self._category_of[value] = category
            categories.append(category)
        return np.array(categories, np.int64)

    def _note(self, different: Any, wrong: Ints) -> None:
        """Note the rows of values without a category.

        Args:
            wrong: (n,) places among the different values of those that have no category, -1 for a
                value with one.
        """
        rows = np.flatnonzero(wrong >= 0)
        places, first, numbers = np.unique(wrong[rows], return_index=True, return_counts=True)
        for at in np.argsort(first):
            value = None
            if places[at] < len(different):
                value = _values(different.slice(int(places[at]), 1))[0]
            row, number = self._rows + int(rows[first[at]]), int(numbers[at])
            if value is None or value != value:
                self._missing = self._missing or _Rows(row)
                self._missing.number += number
                continue
            if self._unknown is None:
                self._unknown, self._first_unknown = _Rows(row), value
            self._unknown.number += number
            if value in self._each or len(self._each) < MOST_DIFFERENT:
                self._each.setdefault(value, _Rows(row)).number += number

    def _explained(self, value: Any, group: int, hint: bool = True) -> str:
        """What is wrong with a group of different values, the first of which is given.

        Args:
            hint: whether to look for the name that is meant.
        """
        expected = _expected(self.variable, str(value) if hint else "")
        if group > MOST_CATEGORIES and self.variable.kind == "categorical":
            return (
                f"{self.variable.name} has {_count(len(self._category_of))} different values, as "
                "an "
                "identifier or a measurement has; "
                f"expected {expected}, or give it an interval with cuts"
            )
        is_text = isinstance(value, str) and not NUMBER.fullmatch(value.strip())
        shown = repr(value) if is_text else str(value)
        others = f" and {_count(group - 1)} other values" if group > 1 else ""
        return f"{self.variable.name} must be {expected}, got {shown}{others}"


def _count(number: int) -> str:
    return f"{number:,}" if number < MOST_DIFFERENT - 1 else f"at least {number:,}"


def numbers_of(name: str, column: Column) -> Floats:
    """The (n,) numbers of a column, times as seconds since 1970, UTC; nan for what is none.

    Values of a wrong type raise ValueError.
    """
    different, where = _different(
        Variable(name, "continuous", low=-np.inf, high=np.inf, cuts=(0,)), column
    )
    return np.asarray(np.append(_numbers(different), np.nan)[where], float)


def _different(variable: Variable, column: Column) -> tuple[Any, Ints]:
    """The (m,) different values of a column, as an Arrow array, and the (n,) places of its values
    among them; m for null.

    Numbers in a range count as different, because each is cheaper to place than to find among
    others.
    """
    kind = column.type
    if pa.types.is_nested(kind) or pa.types.is_binary(kind) or pa.types.is_large_binary(kind):
        raise ValueError(
            f"{variable.name}: expected texts, numbers, booleans or times, got values of type "
            f"{kind}"
        )
    if pa.types.is_null(kind) or pa.types.is_float16(kind):
        column = column.cast(pa.string() if pa.types.is_null(kind) else pa.float32())
    elif pa.types.is_dictionary(kind) and not pa.types.is_string(kind.value_type):
        column = column.cast(kind.value_type)
    whole = column.combine_chunks()
    if variable.kind != "categorical" and (
        pa.types.is_integer(whole.type) or pa.types.is_floating(whole.type)
    ):
        return whole, np.where(np.isnan(_array(whole)), len(whole), np.arange(len(whole)))
    if not pa.types.is_dictionary(whole.type):
        whole = whole.dictionary_encode()
    places = _array(whole.indices)
    return whole.dictionary, np.where(np.isnan(places), len(whole.dictionary), places).astype(
        np.int64
    )


def _array(numbers: Any) -> Any:
    """Arrow's numbers as an array, with nan for null."""
    # Arrow's own conversion imports pandas first, which takes a second.
    return numbers.to_numpy(zero_copy_only=False) if numbers.null_count else np.from_dlpack(numbers)


def _values(different: Any) -> list[Any]:
    """Python's values; a number of single precision as it is written, not as its double."""
    if pa.types.is_float32(different.type):
        return list(map(float, map(str, different.to_numpy())))
    return list(different.to_pylist())


def _ranged(variable: Variable, different: Any) -> Ints:
    numbers = _numbers(different)
    names = {label: index for index, label in enumerate(variable.labels)}
    if pa.types.is_float32(different.type):
        for bound in (variable.low, variable.high, *(variable.cuts or ())):
            numbers[numbers == np.float32(bound)] = bound  # Single precision of 0.7 is below it.
    inside = (numbers >= variable.low) & (numbers <= variable.high)
    categories = np.full(len(numbers), -1)
    categories[inside] = variable.categorise(numbers[inside])
    for place in np.flatnonzero(np.isnan(numbers)):
        categories[place] = names.get(str(different[int(place)].as_py()).strip(), -1)
    return categories


def _numbers(different: Any) -> Floats:
    """Values as numbers, nan for what is none. Times are seconds since 1970, UTC."""
    kind = different.type
    if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
        microseconds = different.cast(pa.timestamp("us"), safe=False).cast(pa.int64())
        return np.asarray(microseconds.to_numpy(zero_copy_only=False) / 1e6)
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        return np.asarray(_array(different), float)
    numbers = np.full(len(different), np.nan)
    if not pa.types.is_boolean(kind):
        for place, text in enumerate(map(str, different.to_pylist())):
            with suppress(ValueError):
                numbers[place] = float(text) if text.isascii() and "_" not in text else np.nan
                continue
            if (time := time_of(text)) is not None:
                numbers[place] = (time - EPOCH).total_seconds()
    return numbers


def _expected(variable: Variable, wrong: str = "") -> str:
    if variable.kind != "categorical":
        ends = f"[{number_text(variable.low)}, {number_text(variable.high)}]"
        return f"a number in {ends} {variable.unit}".rstrip()
    close = difflib.get_close_matches(wrong, variable.values, n=1, cutoff=0.5) if wrong else []
    shown = variable.values if len(variable.values) <= 12 else (*variable.values[:6], "…")
    return f"one of {', '.join(shown)}" + (f" (did you mean '{close[0]}'?)" if close else "")
