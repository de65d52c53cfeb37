"""A variable of a space: its values, and the categories that coverage counts.

Source: thesis Def. 4.2; Cheng et al., Def. 1.
"""

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


PLAIN: Mapping[str, tuple[str, Callable[[Any], bool]]] = {
    "kind": (
        f"one of {', '.join(get_args(Kind))}",
        lambda value: isinstance(value, str) and value in get_args(Kind),
    ),
    "unit": ("text", lambda value: isinstance(value, str)),
    **dict.fromkeys(("low", "high", "step"), ("a number", _is_number)),
    "cyclic": ("true or false", lambda value: isinstance(value, bool)),
    "values": (
        "a list of names",
        lambda values: isinstance(values, list | tuple) and all(isinstance(v, str) for v in values),
    ),
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
    """The shortest text of a number from which the same number can be read.

    >>> number_text(30.0), number_text(0.1)
    ('30', '0.1')
    """
    if float(number).is_integer() and abs(number) < 1e15:
        return str(int(number))
    return repr(float(number))


@dataclass(frozen=True)
class Variable:
    """A variable of a space; its values are encoded as numbers.

    Args:
        name: unique in the space.
        kind: `categorical`, with `values`; `continuous` or `integer`, with bounds.
        unit: of the numbers, such as `m/s`; empty for none.
        low: lower bound, in `unit`.
        high: upper bound, in `unit`; above `low`.
        step: distance of the categories low, low + step, ..., in `unit`. A value belongs to the
            nearest one.
        cyclic: whether `high` and `low` are the same value, as for an angle. With cuts, the first
            and the last part are then one category.
        values: names of the categories of a categorical variable, encoded by their index.
        attributes: numbers of each value by name, such as the height of a pedestrian, which say
            what values are alike.
        cuts: in place of a step, for a continuous variable: its categories are the parts between
            them. A part includes its lower end, the last part also its upper end.
        weights: whole number of points wanted in each category; 1 each if empty.
        mildest: the value that is easiest for a detector.

    Raises:
        ValueError: the settings contradict each other; the message names the variable.

    >>> speed = Variable("speed", "continuous", "m/s", low=0, high=3, step=0.5)
    >>> speed.size, speed.labels[:3]
    (7, ('0', '0.5', '1'))
    >>> speed.categorise(np.array([0.2, 0.3, 3.0])).tolist()
    [0, 1, 6]
    >>> Variable("fog", "continuous", "%", low=0, high=100, cuts=(20, 50)).labels
    ('[0, 20)', '[20, 50)', '[50, 100]')
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
        problem = problem or self._wrong_categories()
        if problem:
            raise ValueError(f"variable '{self.name}': {problem}")

    def _wrong_values(self) -> str:
        count = len(self.values)
        if not self.values or len(set(self.values)) != count:
            return f"values must be distinct and not empty, got {self.values}"
        for name, numbers in self.attributes:
            if len(numbers) != count:
                return (
                    f"attribute '{name}' must have {count} numbers, one a value, got {len(numbers)}"
                )
        return ""

    def _wrong_range(self) -> str:
        low, high, step, cuts = self.low, self.high, self.step, self.cuts
        if self.attributes:
            return "only the values of a categorical variable have attributes"
        if not low < high:
            return f"low must be below high, got {low} to {high}"
        if cuts is not None:
            if self.kind == "integer" or step:
                return "cuts are for a continuous variable without a step"
            if any(a >= b for a, b in pairwise((low, *cuts, high))):
                inside = f"({number_text(low)}, {number_text(high)})"
                return f"cuts must rise inside {inside}, got {list(cuts)}"
            if self.cyclic and len(cuts) == 1:
                return f"a cyclic variable needs no cut or at least two, got {list(cuts)}"
            return ""
        if self.kind == "integer" and any(number != int(number) for number in (low, high, step)):
            numbers = f"{low:g}, {high:g} and {step:g}"
            return f"low, high and step of an integer must be whole, got {numbers}"
        if not 0 < step <= high - low:
            return f"step must be in (0, {high - low}], got {step}"
        if self.cyclic and abs((high - low) / step - self.size) > TOLERANCE:
            return f"step must divide the circle of {high - low:g}, got {step}"
        return ""

    def _wrong_categories(self) -> str:
        if self.weights and len(self.weights) != self.size:
            return f"weights must have {self.size} numbers, one a category, got {len(self.weights)}"
        if any(weight != int(weight) or not 0 <= weight <= HEAVIEST for weight in self.weights):
            return f"weights must be whole numbers from 0 to {HEAVIEST}, got {list(self.weights)}"
        categorical = self.kind == "categorical"
        if self.mildest is not None and isinstance(self.mildest, str) != categorical:
            expected = "the name of a value" if categorical else "a number"
            return f"mildest must be {expected}, got {self.mildest!r}"
        return ""

    @property
    def mild(self) -> float | None:
        """The mildest value, encoded: the nearest one to it in the range.

        None if none is declared, or if it is not among the values.
        """
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
        steps = int(np.floor((self.high - self.low) / self.step + TOLERANCE))
        return steps if self.cyclic else steps + 1

    @cached_property
    def _parts(self) -> tuple[tuple[float, float], ...]:
        """Start and end of each part; the one with the ends of a cyclic variable comes last."""
        parts = list(pairwise((self.low, *(self.cuts or ()), self.high)))
        if self._wraps:
            parts = [*parts[1:-1], (parts[-1][0], parts[0][1])]
        return tuple(parts)

    @property
    def _wraps(self) -> bool:
        return self.cyclic and bool(self.cuts)

    @property
    def grid(self) -> Floats:
        """Encoded representative of each category, (size,): its grid value or its part's middle."""
        if self.kind == "categorical":
            return np.arange(self.size, dtype=float)
        if self.cuts is not None:
            return self._inside_parts(np.arange(self.size), np.full(self.size, 0.5))
        values = self.low + self.step * np.arange(self.size, dtype=np.float64)
        return np.minimum(values, self.high)  # 3 * 0.2 is more than 0.6.

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Name of each category, (size,)."""
        if self.cuts is not None:
            ends = [")"] * (self.size - 1) + [")" if self._wraps else "]"]
            return tuple(
                f"[{number_text(low)}, {number_text(high)}{end}"
                for (low, high), end in zip(self._parts, ends, strict=True)
            )
        if self.values:
            return self.values
        # As few digits, from six, as keep the grid values apart.
        for digits in range(6, 17):
            rounded = [float(f"{value:.{digits}g}") for value in self.grid]
            if np.abs(np.array(rounded) - self.grid).max() <= self.step / 100:
                return tuple(map(number_text, rounded))
        return tuple(map(number_text, self.grid.tolist()))

    @property
    def rounding(self) -> float:
        """Unit of a readable bound: half a step, or a hundredth of a range without steps."""
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
            # A cyclic variable's ends are one value.
            count = self.high - self.low + (0 if self.cyclic else 1)
            return np.minimum(self.low + np.floor(unit * count), self.high)
        return self.low + unit * (self.high - self.low)

    def within(self, categories: Ints, unit: Floats) -> Floats:
        """Values inside categories.

        Args:
            categories: (n,) category indices.
            unit: (n,) relative positions inside the categories, in [0, 1).

        Returns:
            (n,) encoded values.
        """
        if self.cuts is not None:
            return self._inside_parts(categories, unit)
        values = self.grid[categories]
        if self.kind == "categorical":
            return values
        first, last = values - self.step / 2, values + self.step / 2
        if self.kind == "integer":
            first, last = np.ceil(first), np.ceil(last) - 1
        if self.cyclic:
            values = first + self.step * unit
            if self.kind == "integer":
                values = first + np.floor(unit * (last - first + 1))
            return np.asarray(self.low + (values - self.low) % (self.high - self.low))
        first = np.maximum(first, self.low)
        # The last category includes the remainder of the steps.
        last = np.where(categories == self.size - 1, self.high, np.minimum(last, self.high))
        if self.kind == "integer":
            return np.asarray(np.minimum(first + np.floor(unit * (last - first + 1)), last))
        return np.asarray(first + unit * (last - first))

    def _inside_parts(self, categories: Ints, unit: Floats) -> Floats:
        span = self.high - self.low
        first, last = np.array(self._parts).T
        # The part with the ends of a cyclic variable ends below its start.
        last = np.where(last > first, last, last + span)
        values = first[categories] + unit * (last - first)[categories]
        return np.asarray(np.where(values > self.high, values - span, values))

    def encode(self, value: Value) -> float:
        """The number of a value.

        Raises:
            ValueError: no such value; the message names the variable, the expected values and the
                actual one.
        """
        if self.kind == "categorical":
            if value not in self.values:
                raise ValueError(
                    f"{self.name} must be one of {', '.join(self.values)}; got {value!r}"
                )
            return float(self.values.index(str(value)))
        if isinstance(value, str) or not np.isfinite(value) or not self.low <= value <= self.high:
            bounds = f"[{number_text(self.low)}, {number_text(self.high)}] {self.unit}"
            raise ValueError(f"{self.name} must be in {bounds}, got {value!r}")
        if self.kind == "integer" and value != int(value):
            raise ValueError(f"{self.name} must be a whole number, got {value!r}")
        return float(value)

    def decode(self, number: float) -> Value:
        """Inverse of `encode`."""
        return self.values[int(number)] if self.kind == "categorical" else float(number)

    def to_dict(self) -> dict[str, Any]:
        """Plain data without the name; `from_dict` reads it back."""
        plain: dict[str, Any] = {"kind": self.kind}
        if self.kind == "categorical":
            if self.unit:
                plain["unit"] = self.unit
            plain["values"] = list(self.values)
            if self.attributes:
                plain["attributes"] = {name: list(numbers) for name, numbers in self.attributes}
        else:
            plain |= {"unit": self.unit, "low": self.low, "high": self.high}
            if self.cuts is None:
                plain["step"] = self.step
            else:
                plain["cuts"] = list(self.cuts)
            plain["cyclic"] = self.cyclic
        if self.mildest is not None:
            plain["mildest"] = self.mildest
        if self.weights:
            plain["weights"] = list(self.weights)
        return plain

    @staticmethod
    def from_dict(name: str, plain: Mapping[str, Any]) -> Variable:
        """The variable of plain data.

        Raises:
            ValueError: an unknown key, a value of a wrong type, or one that `Variable` rejects.
        """
        for key, value in plain.items():
            if key not in PLAIN:
                raise ValueError(f"unknown key '{name}.{key}'{nearest(key, PLAIN)}")
            expected, is_right = PLAIN[key]
            if not is_right(value):
                raise ValueError(f"{name}.{key}: expected {expected}, got {shown(value)}")
        if "kind" not in plain:
            raise ValueError(f"key '{name}.kind' is missing")
        settings = dict(plain)
        for key in ("values", "cuts", "weights"):
            if key in settings:
                settings[key] = tuple(settings[key])
        if "attributes" in settings:
            settings["attributes"] = tuple(
                (key, tuple(map(float, numbers))) for key, numbers in settings["attributes"].items()
            )
        return Variable(name=name, **settings)
