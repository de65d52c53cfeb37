"""The logical scenario space S = S1 x ... x Sn (thesis Def. 4.2) and its encoding as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Value = float | str
"""A scenario variable's value: a number in the variable's unit, or the name of a category."""
Kind = Literal["continuous", "integer", "categorical"]
TOLERANCE = 1e-9


@dataclass(frozen=True)
class Variable:
    """One scenario variable.

    A continuous or integer one has bounds `low` to `high` in `unit`, and a `step`: its categories, which coverage counts, are
    the grid values low, low + step, ... (a value belongs to the nearest one). A cyclic one identifies `high` with `low`.
    A categorical one has `values` and is encoded by its index. `attributes` are numbers that are known of each of its values, such as
    the height of a pedestrian; they say which values are alike, to those who learn from results.
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

    def __post_init__(self) -> None:
        if self.kind == "categorical":
            if not self.values or len(set(self.values)) != len(self.values):
                raise ValueError(f"variable '{self.name}': values must be distinct and not empty, got {self.values}")
            for name, numbers in self.attributes:
                if len(numbers) != len(self.values):
                    raise ValueError(
                        f"variable '{self.name}': attribute '{name}' must have {len(self.values)} numbers, one a value, got {len(numbers)}"
                    )
        elif self.attributes:
            raise ValueError(f"variable '{self.name}': only the values of a categorical variable have attributes")
        elif not self.low < self.high:
            raise ValueError(f"variable '{self.name}': low must be below high, got {self.low} to {self.high}")
        elif not 0 < self.step <= self.high - self.low:
            raise ValueError(f"variable '{self.name}': step must be in (0, {self.high - self.low}], got {self.step}")
        elif self.cyclic and abs((self.high - self.low) / self.step - self.size) > TOLERANCE:
            raise ValueError(f"variable '{self.name}': step must divide the circle of {self.high - self.low:g}, got {self.step}")

    @property
    def size(self) -> int:
        """Number of categories."""
        if self.kind == "categorical":
            return len(self.values)
        return int(np.floor((self.high - self.low) / self.step + TOLERANCE)) + (0 if self.cyclic else 1)

    @property
    def grid(self) -> Floats:
        """(size,) the representative of each category, encoded."""
        if self.kind == "categorical":
            return np.arange(self.size, dtype=float)
        return np.minimum(self.low + self.step * np.arange(self.size, dtype=np.float64), self.high)  # 3 * 0.2 is more than 0.6.

    @property
    def labels(self) -> tuple[str, ...]:
        """(size,) the name of each category."""
        return self.values or tuple(f"{value:g}" for value in self.grid)

    def categorise(self, values: Floats) -> Ints:
        """(n,) encoded values to (n,) category indices."""
        if self.kind == "categorical":
            return values.astype(np.int64)
        index = np.floor((values - self.low) / self.step + 0.5).astype(np.int64)
        return index % self.size if self.cyclic else np.clip(index, 0, self.size - 1)

    def scale(self, unit: Floats) -> Floats:
        """(n,) uniform numbers in [0, 1) to encoded values."""
        if self.kind == "categorical":
            return np.minimum(np.floor(unit * self.size), self.size - 1)
        if self.kind == "integer":
            count = self.high - self.low + 1
            return np.minimum(self.low + np.floor(unit * count), self.high)
        return self.low + unit * (self.high - self.low)

    def within(self, categories: Ints, unit: Floats) -> Floats:
        """(n,) category indices to encoded values that lie as far inside their categories as (n,) numbers in [0, 1) say."""
        values = self.grid[categories]
        if self.kind == "categorical":
            return values
        if self.kind == "integer":
            first, last = np.ceil(values - self.step / 2), np.ceil(values + self.step / 2) - 1
            first, last = np.maximum(first, self.low), self._ends(categories, last)
            return np.asarray(np.minimum(first + np.floor(unit * (last - first + 1)), last))
        first, last = values - self.step / 2, values + self.step / 2
        if self.cyclic:
            return np.asarray(self.low + (first + self.step * unit - self.low) % (self.high - self.low))
        first, last = np.maximum(first, self.low), self._ends(categories, last)
        return np.asarray(first + unit * (last - first))

    def _ends(self, categories: Ints, last: Floats) -> Floats:
        """Where categories end: the last one has what the steps leave over, too."""
        return np.where(categories == self.size - 1, self.high, np.minimum(last, self.high))

    def encode(self, value: float | str) -> float:
        """One value to its number; ValueError that names the variable, what was expected and what came."""
        if self.kind == "categorical":
            if value not in self.values:
                raise ValueError(f"{self.name} must be one of {', '.join(self.values)}; got {value!r}")
            return float(self.values.index(str(value)))
        if isinstance(value, str) or not np.isfinite(value) or not self.low <= value <= self.high:
            raise ValueError(f"{self.name} must be in [{self.low:g}, {self.high:g}] {self.unit}, got {value!r}")
        return float(value)

    def decode(self, number: float) -> float | str:
        """Inverse of `encode`."""
        return self.values[int(number)] if self.kind == "categorical" else float(number)


@dataclass(frozen=True)
class Space:
    """A logical scenario space. Points are (n, d) float64 arrays, columns in the order of `variables`."""

    variables: tuple[Variable, ...]

    def __post_init__(self) -> None:
        if not self.variables or len(set(self.names)) != len(self.names):
            raise ValueError(f"a space needs variables with distinct names, got {self.names}")

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(variable.name for variable in self.variables)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of categories of each variable."""
        return tuple(variable.size for variable in self.variables)

    def __len__(self) -> int:
        return len(self.variables)

    def sample(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, d) points, each variable independent and uniform (thesis Table 6.1, row 1)."""
        return self.scale(rng.random((count, len(self))))

    def scale(self, unit: Floats) -> Floats:
        """(n, d) numbers in [0, 1) to points."""
        return np.column_stack([v.scale(unit[:, j]) for j, v in enumerate(self.variables)])

    def categorise(self, points: Floats) -> Ints:
        """(n, d) points to (n, d) category indices."""
        return np.column_stack([v.categorise(points[:, j]) for j, v in enumerate(self.variables)])

    def representatives(self, categories: Ints) -> Floats:
        """(n, d) category indices to the points that stand for them."""
        return np.column_stack([v.grid[categories[:, j]] for j, v in enumerate(self.variables)])

    def within(self, categories: Ints, rng: np.random.Generator) -> Floats:
        """(n, d) category indices to points drawn inside those categories."""
        unit = rng.random(categories.shape)
        return np.column_stack([v.within(categories[:, j], unit[:, j]) for j, v in enumerate(self.variables)])

    def encode(self, concrete: Mapping[str, float | str]) -> Floats:
        """One concrete scenario to a (d,) point; ValueError for a missing, unknown or out-of-range variable."""
        if set(concrete) != set(self.names):
            missing, unknown = set(self.names) - set(concrete), set(concrete) - set(self.names)
            raise ValueError(f"variables must be {list(self.names)}; missing {sorted(missing)}, unknown {sorted(unknown)}")
        return np.array([v.encode(concrete[v.name]) for v in self.variables])

    def decode(self, point: Floats) -> dict[str, float | str]:
        """One (d,) point to a concrete scenario."""
        return {v.name: v.decode(point[j]) for j, v in enumerate(self.variables)}

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Plain data, `name: {kind, unit, ...}`, in order; `from_dict` reads it back."""
        return {v.name: _plain(v) for v in self.variables}

    @staticmethod
    def from_dict(plain: Mapping[str, Mapping[str, Any]]) -> Space:
        return Space(tuple(_variable(name, body) for name, body in plain.items()))


def _plain(variable: Variable) -> dict[str, Any]:
    if variable.kind == "categorical":
        known = {"attributes": {name: list(numbers) for name, numbers in variable.attributes}} if variable.attributes else {}
        return {"kind": variable.kind, "values": list(variable.values), **known}
    keys: Sequence[str] = ("kind", "unit", "low", "high", "step", "cyclic")
    return {key: getattr(variable, key) for key in keys}


def _variable(name: str, body: Mapping[str, Any]) -> Variable:
    values: dict[str, Any] = {key: tuple(value) if key == "values" else value for key, value in body.items()}
    if "attributes" in values:
        values["attributes"] = tuple((key, tuple(float(number) for number in numbers)) for key, numbers in values["attributes"].items())
    return Variable(name=name, **values)
