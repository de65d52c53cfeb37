"""Operating conditions (Cheng et al., Definition 1): what a point is categorised by, with weights, units and constraints."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from pipeline.core.constraints import Constraints, parse_literal
from pipeline.core.space import Ints

MOST_CATEGORIES = 5000
"""Of one condition: more are most likely an identifier or a measurement that needs cuts."""


@dataclass(frozen=True)
class Condition:
    """One condition: named values, or an interval that `cuts` divide.

    interval: both ends, in `unit`; a category holds its lower end, the last one also its upper one. cyclic: the interval's ends are
    the same place, so its first and last parts are one category. weights: whole numbers of points wanted of each category.
    """

    name: str
    values: tuple[str, ...] = ()
    interval: tuple[float, float] | None = None
    cuts: tuple[float, ...] = ()
    cyclic: bool = False
    unit: str = ""
    weights: tuple[int, ...] = ()

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """The names of the categories."""
        if self.interval is None:
            return self.values
        edges = [self.interval[0], *self.cuts, self.interval[1]]
        parts = list(pairwise(edges))
        if self.cyclic and self.cuts:
            parts = [*parts[1:-1], (parts[-1][0], parts[0][1])]
        ends = [")"] * (len(parts) - 1) + [")" if self.cyclic and self.cuts else "]"]
        return tuple(f"[{low:g}, {high:g}{end}" for (low, high), end in zip(parts, ends, strict=True))

    @property
    def size(self) -> int:
        return len(self.labels)

    def categorise(self, column: Sequence[Any]) -> Ints:
        """(n,) values, or names of categories, to category indices; ValueError names the row, from 1, what was expected and what came."""
        if self.interval is not None:
            return self._parts(column)
        if isinstance(column, np.ndarray):
            different, where = np.unique(column, return_inverse=True)
            if len(different) < len(column):
                try:
                    return self.categorise(different)[where]
                except ValueError:
                    column = column.tolist()  # To name the first row.
        index = {label: i for i, label in enumerate(self.values)}
        distinct = {value: next((index[text] for text in _spellings(value) if text in index), -1) for value in dict.fromkeys(column)}
        for value, category in distinct.items():
            if category < 0:
                row = list(column).index(value) if value == value else next(i for i, v in enumerate(column) if v != v)
                expected = self._expected(_shown(value))
                if len(distinct) > MOST_CATEGORIES:
                    raise ValueError(
                        f"row {row + 1}: {self.name} has {len(distinct):,} different values, as an identifier or a measurement has; "
                        f"expected {expected}, or give it an interval with cuts"
                    )
                raise ValueError(f"row {row + 1}: {self.name} must be {expected}, got {_shown(value)}")
        return np.array([distinct[value] for value in column], dtype=np.int64)

    def _parts(self, column: Sequence[Any]) -> Ints:
        assert self.interval is not None
        named = np.full(len(column), -1)
        numeric = isinstance(column, np.ndarray) and column.dtype.kind in "fiu"
        numbers = np.asarray(column, float) if numeric else np.empty(len(column))
        for row, value in enumerate(() if numeric else column):
            try:
                numbers[row] = float(value)
            except (TypeError, ValueError):
                known = isinstance(value, str) and value.strip() in self.labels
                numbers[row] = self.interval[0] if known else np.nan
                named[row] = self.labels.index(value.strip()) if known else -1
        low, high = self.interval
        outside = ~((numbers >= low) & (numbers <= high))
        if outside.any():
            row = int(np.argmax(outside))
            expected = f"a number in [{low:g}, {high:g}] {self.unit}".rstrip()
            raise ValueError(f"row {row + 1}: {self.name} must be {expected}, got {_shown(column[row])}")
        part = np.searchsorted(self.cuts, numbers, side="right")
        if self.cyclic and self.cuts:
            part = np.where(part == 0, self.size, part) - 1
        return np.where(named >= 0, named, part).astype(np.int64)

    def _expected(self, wrong: str) -> str:
        close = difflib.get_close_matches(wrong.strip("'"), self.values, n=1, cutoff=0.5)
        shown = self.values if len(self.values) <= 12 else (*self.values[:6], "…")
        return f"one of {', '.join(shown)}" + (f" (did you mean '{close[0]}'?)" if close else "")


def _text(value: Any) -> str:
    return str(value).strip()


def _spellings(value: Any) -> Iterator[str]:
    """How a value of a table may be written in a space file: as it is, whole numbers without a point, truth values in small letters."""
    text = _text(value)
    yield text
    yield text.lower() if text.lower() in ("true", "false") else text
    try:
        if float(text).is_integer():
            yield str(int(float(text)))
    except (ValueError, OverflowError):
        return


def _shown(value: Any) -> str:
    if value is None or value != value:
        return "nothing"
    return repr(value) if isinstance(value, str) else f"{value:g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class OperatingSpace:
    """Conditions and the clauses between them, as they were written."""

    conditions: tuple[Condition, ...]
    clauses: tuple[tuple[str, ...], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(condition.name for condition in self.conditions)

    @property
    def sizes(self) -> tuple[int, ...]:
        return tuple(condition.size for condition in self.conditions)

    @property
    def weights(self) -> list[tuple[int, ...]]:
        return [condition.weights for condition in self.conditions]

    @cached_property
    def constraints(self) -> Constraints:
        """The clauses by index; ValueError that names a wrong literal."""
        labels = {condition.name: condition.labels for condition in self.conditions}
        return Constraints(self.sizes, tuple(tuple(parse_literal(text, labels) for text in clause) for clause in self.clauses))

    def clause(self, index: int) -> str:
        """A clause in words."""
        return " or ".join(self.clauses[index]) or "nothing (an empty clause)"

    def categorise(self, columns: Mapping[str, Sequence[Any]]) -> Ints:
        """(n, d) category indices of a table's columns; ValueError that names a wrong value, or a row that breaks a clause."""
        if missing := [name for name in self.names if name not in columns]:
            raise ValueError(f"expected a column for each condition; there is none for {', '.join(missing)}, only {', '.join(columns)}")
        points = np.column_stack([condition.categorise(columns[condition.name]) for condition in self.conditions])
        if broken := self.constraints.first_broken(points):
            row, clause = broken
            where = ", ".join(f"{c.name} = {c.labels[v]}" for c, v in zip(self.conditions, points[row], strict=True))
            raise ValueError(f"row {row + 1} breaks the constraint '{self.clause(clause)}': {where}")
        return points

    def decode(self, points: Ints) -> list[dict[str, str]]:
        """(n, d) category indices to the names of the categories."""
        return [{c.name: c.labels[int(v)] for c, v in zip(self.conditions, row, strict=True)} for row in points]
