"""One variable of a space: its values, and the categories that coverage counts (thesis Def. 4.2; Cheng et al., Def. 1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.core.names import nearest
from pipeline.errors import shown

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Value = float | str
"""A variable's value: a number in its unit, or the name of a category."""
Kind = Literal["continuous", "integer", "categorical"]
TOLERANCE = 1e-9
LARGEST = 1e9
"""Largest bound of a number."""
HEAVIEST = 1000
"""Largest weight of a category: products over six variables stay exact."""


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST


def _are_numbers(values: Any) -> bool:
    return isinstance(values, list | tuple) and all(map(_is_number, values))


def _are_names(values: Any) -> bool:
    return isinstance(values, list | tuple) and all(isinstance(value, str) for value in values)


PLAIN: Mapping[str, tuple[str, Callable[[Any], bool]]] = {
    "kind": (
        f"one of {', '.join(get_args(Kind))}",
        lambda value: isinstance(value, str) and value in get_args(Kind),
    ),
    "unit": ("text", lambda value: isinstance(value, str)),
    **dict.fromkeys(("low", "high", "step"), ("a number", _is_number)),
    "cyclic": ("true or false", lambda value: isinstance(value, bool)),
    "values": ("a list of names", _are_names),
    "attributes": (
        "lists of numbers by name",
        lambda value: isinstance(value, Mapping) and all(map(_are_numbers, value.values())),
    ),
    "cuts": ("a list of numbers", _are_numbers),
    "weights": ("a list of numbers", _are_numbers),
    "mildest": ("a number or a name", lambda value: isinstance(value, str) or _is_number(value)),
}
"""The keys of a variable in plain data, what each expects, and whether a value is of that type."""


def number_text(number: float) -> str:
    """The shortest text of a number from which the same number can be read; whole numbers have no point."""
    return (
        str(int(number))
        if float(number).is_integer() and abs(number) < 1e15
        else repr(float(number))
    )


@dataclass(frozen=True)
class Variable:
    """One variable of a space.

    A categorical variable has `values` and is encoded by their index. `attributes` are known numbers of each value, such as the height of a
    pedestrian; strategies that learn from results use them to tell which values are alike.

    A continuous or integer variable has bounds `low` to `high` in `unit`, and a `step`: its categories are the grid values low, low + step,
    ... (a value belongs to the nearest one). A continuous variable may have `cuts` instead: its categories are the parts between them; a
    part includes its lower end, the last part also its upper end. A cyclic variable identifies `high` with `low`, so with cuts its first
    and last parts are one category.

    weights: whole numbers of points wanted for each category, 1 each by default. mildest: the value that is easiest for a detector.
    """

    name: str
    kind: Kind
    unit: str = ""
    low: float = 0.0
    high: float = 0.0
    step: float = 0.0
    cyclic: bool = False
    values: tuple[str, ...] = ()
    attributes: tuple[tuple[str, tuple[float, ...]], ...] = ()
    cuts: tuple[float, ...] | None = None
    weights: tuple[int, ...] = ()
    mildest: Value | None = None

    def __post_init__(self) -> None:
        problem = self._wrong_values() if self.kind == "categorical" else self._wrong_range()
        if problem := problem or self._wrong_weights() or self._wrong_mildest():
            raise ValueError(f"variable '{self.name}': {problem}")

    def _wrong_values(self) -> str:
        if not self.values or len(set(self.values)) != len(self.values):
            return f"values must be distinct and not empty, got {self.values}"
        for name, numbers in self.attributes:
            if len(numbers) != len(self.values):
                return f"attribute '{name}' must have {len(self.values)} numbers, one a value, got {len(numbers)}"
        return ""

    def _wrong_range(self) -> str:
        if self.attributes:
            return "only the values of a categorical variable have attributes"
        if not self.low < self.high:
            return f"low must be below high, got {self.low} to {self.high}"
        if self.cuts is not None:
            return self._wrong_cuts()
        if self.kind == "integer" and any(
            number != int(number) for number in (self.low, self.high, self.step)
        ):
            return f"low, high and step of an integer must be whole, got {self.low:g}, {self.high:g} and {self.step:g}"
        if not 0 < self.step <= self.high - self.low:
            return f"step must be in (0, {self.high - self.low}], got {self.step}"
        if self.cyclic and abs((self.high - self.low) / self.step - self.size) > TOLERANCE:
            return f"step must divide the circle of {self.high - self.low:g}, got {self.step}"
        return ""

    def _wrong_cuts(self) -> str:
        assert self.cuts is not None
        if self.kind == "integer" or self.step:
            return "cuts are for a continuous variable without a step"
        if any(a >= b for a, b in pairwise((self.low, *self.cuts, self.high))):
            return f"cuts must rise inside ({number_text(self.low)}, {number_text(self.high)}), got {list(self.cuts)}"
        if self.cyclic and len(self.cuts) == 1:
            return f"a cyclic variable needs no cut or at least two, got {list(self.cuts)}"
        return ""

    def _wrong_weights(self) -> str:
        if self.weights and len(self.weights) != self.size:
            return f"weights must have {self.size} numbers, one a category, got {len(self.weights)}"
        if any(weight != int(weight) or not 0 <= weight <= HEAVIEST for weight in self.weights):
            return f"weights must be whole numbers from 0 to {HEAVIEST}, got {list(self.weights)}"
        return ""

    def _wrong_mildest(self) -> str:
        if self.mildest is not None and isinstance(self.mildest, str) != (
            self.kind == "categorical"
        ):
            return f"mildest must be {'the name of a value' if self.kind == 'categorical' else 'a number'}, got {self.mildest!r}"
        return ""

    @property
    def mild(self) -> float | None:
        """The mildest value, encoded: the nearest one to it in the range. None if none is declared, or if it is not among the values."""
        if self.mildest is None:
            return None
        if isinstance(self.mildest, str):
            return float(self.values.index(self.mildest)) if self.mildest in self.values else None
        return min(max(float(self.mildest), self.low), self.high)

    @property
    def size(self) -> int:
        """Number of categories."""
        if self.kind == "categorical":
            return len(self.values)
        if self.cuts is not None:
            return len(self._parts)
        return int(np.floor((self.high - self.low) / self.step + TOLERANCE)) + (
            0 if self.cyclic else 1
        )

    @cached_property
    def _parts(self) -> tuple[tuple[float, float], ...]:
        """Start and end of each part between the cuts; the part that contains the ends of a cyclic variable comes last."""
        parts = list(pairwise((self.low, *(self.cuts or ()), self.high)))
        return tuple([*parts[1:-1], (parts[-1][0], parts[0][1])] if self._wraps else parts)

    @property
    def _wraps(self) -> bool:
        return self.cyclic and bool(self.cuts)

    @property
    def grid(self) -> Floats:
        """Representative of each category, encoded, (size,): its grid value, or the middle of its part."""
        if self.kind == "categorical":
            return np.arange(self.size, dtype=float)
        if self.cuts is not None:
            return self._inside_parts(np.arange(self.size), np.full(self.size, 0.5))
        return np.minimum(
            self.low + self.step * np.arange(self.size, dtype=np.float64), self.high
        )  # 3 * 0.2 is more than 0.6.

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Name of each category, (size,)."""
        if self.cuts is None:
            return self.values or self._grid_labels
        ends = [")"] * (self.size - 1) + [")" if self._wraps else "]"]
        return tuple(
            f"[{number_text(low)}, {number_text(high)}{end}"
            for (low, high), end in zip(self._parts, ends, strict=True)
        )

    @property
    def _grid_labels(self) -> tuple[str, ...]:
        """The grid values with as few digits, from six, as keep them apart."""
        for digits in range(6, 17):
            rounded = [float(f"{value:.{digits}g}") for value in self.grid]
            if np.abs(np.array(rounded) - self.grid).max() <= self.step / 100:
                return tuple(map(number_text, rounded))
        return tuple(map(number_text, self.grid.tolist()))

    @property
    def rounding(self) -> float:
        """Rounding unit of a readable bound: half a step, or a hundredth of a range without steps."""
        return self.step / 2 if self.cuts is None else (self.high - self.low) / 100

    def categorise(self, values: Floats) -> Ints:
        """Convert (n,) encoded values to (n,) category indices."""
        if self.kind == "categorical":
            return values.astype(np.int64)
        if self.cuts is not None:
            part = np.searchsorted(self.cuts, values, side="right").astype(np.int64)
            return np.where(part == 0, self.size, part) - 1 if self._wraps else part
        index = np.floor((values - self.low) / self.step + 0.5).astype(np.int64)
        return index % self.size if self.cyclic else np.clip(index, 0, self.size - 1)

    def scale(self, unit: Floats) -> Floats:
        """Convert (n,) uniform numbers in [0, 1) to encoded values."""
        if self.kind == "categorical":
            return np.minimum(np.floor(unit * self.size), self.size - 1)
        if self.kind == "integer":
            count = (
                self.high - self.low + (0 if self.cyclic else 1)
            )  # A cyclic variable's ends are one value.
            return np.minimum(self.low + np.floor(unit * count), self.high)
        return self.low + unit * (self.high - self.low)

    def within(self, categories: Ints, unit: Floats) -> Floats:
        """Convert (n,) category indices to encoded values; (n,) numbers in [0, 1) give the relative position inside the category."""
        if self.cuts is not None:
            return self._inside_parts(categories, unit)
        values = self.grid[categories]
        if self.kind == "categorical":
            return values
        if self.kind == "integer":
            first, last = np.ceil(values - self.step / 2), np.ceil(values + self.step / 2) - 1
            if self.cyclic:
                return np.asarray(
                    self.low
                    + (first + np.floor(unit * (last - first + 1)) - self.low)
                    % (self.high - self.low)
                )
            first, last = np.maximum(first, self.low), self._ends(categories, last)
            return np.asarray(np.minimum(first + np.floor(unit * (last - first + 1)), last))
        first, last = values - self.step / 2, values + self.step / 2
        if self.cyclic:
            return np.asarray(
                self.low + (first + self.step * unit - self.low) % (self.high - self.low)
            )
        first, last = np.maximum(first, self.low), self._ends(categories, last)
        return np.asarray(first + unit * (last - first))

    def _inside_parts(self, categories: Ints, unit: Floats) -> Floats:
        span = self.high - self.low
        first, last = np.array(self._parts).T
        last = np.where(
            last > first, last, last + span
        )  # The part of a cyclic variable that contains its ends.
        values = first[categories] + unit * (last - first)[categories]
        return np.asarray(np.where(values > self.high, values - span, values))

    def _ends(self, categories: Ints, last: Floats) -> Floats:
        """Ends of the categories: the last one includes the remainder of the steps."""
        return np.where(categories == self.size - 1, self.high, np.minimum(last, self.high))

    def encode(self, value: Value) -> float:
        """Encode one value; ValueError that names the variable, the expected and the actual value."""
        if self.kind == "categorical":
            if value not in self.values:
                raise ValueError(
                    f"{self.name} must be one of {', '.join(self.values)}; got {value!r}"
                )
            return float(self.values.index(str(value)))
        if isinstance(value, str) or not np.isfinite(value) or not self.low <= value <= self.high:
            raise ValueError(
                f"{self.name} must be in [{number_text(self.low)}, {number_text(self.high)}] {self.unit}, got {value!r}"
            )
        if self.kind == "integer" and value != int(value):
            raise ValueError(f"{self.name} must be a whole number, got {value!r}")
        return float(value)

    def decode(self, number: float) -> Value:
        """Inverse of `encode`."""
        return self.values[int(number)] if self.kind == "categorical" else float(number)

    def to_dict(self) -> dict[str, Any]:
        """Plain data without the name; `from_dict` reads it back."""
        known: dict[str, Any] = {"kind": self.kind}
        if self.kind == "categorical":
            known |= {"unit": self.unit} if self.unit else {}
            known["values"] = list(self.values)
            if self.attributes:
                known["attributes"] = {name: list(numbers) for name, numbers in self.attributes}
        else:
            categories = {"step": self.step} if self.cuts is None else {"cuts": list(self.cuts)}
            known |= {
                "unit": self.unit,
                "low": self.low,
                "high": self.high,
                **categories,
                "cyclic": self.cyclic,
            }
        if self.mildest is not None:
            known["mildest"] = self.mildest
        return {**known, "weights": list(self.weights)} if self.weights else known

    @staticmethod
    def from_dict(name: str, plain: Mapping[str, Any]) -> Variable:
        """The variable of plain data; ValueError for an unknown key, a value of a wrong type and one that `Variable` rejects."""
        for key, value in plain.items():
            if key not in PLAIN:
                raise ValueError(f"unknown key '{name}.{key}'{nearest(key, PLAIN)}")
            expected, is_right = PLAIN[key]
            if not is_right(value):
                raise ValueError(f"{name}.{key}: expected {expected}, got {shown(value)}")
        if "kind" not in plain:
            raise ValueError(f"key '{name}.kind' is missing")
        values: dict[str, Any] = {
            key: tuple(value) if key in ("values", "cuts", "weights") else value
            for key, value in plain.items()
        }
        if "attributes" in values:
            values["attributes"] = tuple(
                (key, tuple(float(number) for number in numbers))
                for key, numbers in values["attributes"].items()
            )
        return Variable(name=name, **values)
