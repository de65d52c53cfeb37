"""Numbers with units in OpenODD files, and the bounds that expressions on them set.

Such expressions are "< 40 km/h" and "[2 .. 10] mm/h".
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from math import inf

from pipeline.core.names import nearest

UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "length": {
        "m": (1, 0),
        "km": (1000, 0),
        "cm": (0.01, 0),
        "mm": (0.001, 0),
        "mi": (1609.344, 0),
        "in": (0.0254, 0),
        "ft": (0.3048, 0),
    },
    "velocity": {"m/s": (1, 0), "km/h": (1 / 3.6, 0), "kph": (1 / 3.6, 0), "mph": (0.44704, 0)},
    "acceleration": {"m/s^2": (1, 0), "g": (9.80665, 0)},
    "time": {"s": (1, 0), "ms": (0.001, 0), "msec": (0.001, 0), "min": (60, 0), "h": (3600, 0)},
    "angle": {"deg": (1, 0), "rad": (57.29577951308232, 0)},
    "temperature": {"C": (1, 0), "K": (1, -273.15), "F": (5 / 9, -160 / 9)},
    "fraction": {"": (1, 0), "%": (0.01, 0)},
    "bandwidth": {"bps": (1, 0), "kbps": (1e3, 0), "Mbps": (1e6, 0), "Gbps": (1e9, 0)},
    "frequency": {"Hz": (1, 0), "kHz": (1000, 0)},
}
"""Scale and offset of each unit to the first of its type; a type that is not here has one unit a
concept."""
SIGNED = (
    "temperature",
    "angle",
    "acceleration",
    "force",
    "charge",
    "electric_potential",
    "electric_current",
    "torque",
)
"""Unit types with negative values."""
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
BOUND = re.compile(rf"(?P<sign>[<>]=?)\s*(?P<number>{NUMBER})\s*(?P<unit>[^\d.*$][^*$]*|)")
RANGE = re.compile(
    rf"\[\s*(?P<low>{NUMBER})\s*(?:\.\.|,)\s*(?P<high>{NUMBER})\s*\]\s*(?P<unit>[^*$]*)"
)
EQUAL = re.compile(rf"(?P<number>{NUMBER})\s*(?P<unit>[^\d.*$][^*$]*|)")
DIGITS = 12
"""Significant digits of a converted number."""


@dataclass(frozen=True)
class Bounds:
    """The numbers from low to high, in a unit.

    Attributes:
        below, above: whether the ends themselves are outside.
    """

    low: float
    high: float
    unit: str
    above: bool = False
    below: bool = False

    def holds(self, number: float) -> bool:
        return (self.low < number or (self.low == number and not self.above)) and (
            number < self.high or (self.high == number and not self.below)
        )

    def holds_all(self, other: Bounds) -> bool:
        """Whether it contains the other, except perhaps the other's ends, where parts touch."""
        if other.low == other.high:
            return self.holds(other.low)
        return self.low <= other.low and other.high <= self.high

    def holds_none(self, other: Bounds) -> bool:
        """Whether both share at most an end."""
        if other.low == other.high:
            return not self.holds(other.low)
        return other.high <= self.low or self.high <= other.low


def is_bounds(text: str) -> bool:
    """Whether a text sets bounds for a number."""
    return any(pattern.fullmatch(text.strip()) for pattern in (BOUND, RANGE, EQUAL))


def bounds(text: str) -> Bounds:
    """The bounds of an expression; ValueError that says what was expected."""
    text = text.strip()
    if match := RANGE.fullmatch(text):
        low, high = float(match["low"]), float(match["high"])
        if low > high:
            raise ValueError(f"expected the smaller number first, got {text!r}")
        return Bounds(low, high, match["unit"].strip())
    if match := BOUND.fullmatch(text):
        number, unit, sign = float(match["number"]), match["unit"].strip(), match["sign"]
        if sign.startswith("<"):
            return Bounds(-inf, number, unit, below=sign == "<")
        return Bounds(number, inf, unit, above=sign == ">")
    if match := EQUAL.fullmatch(text):
        number = float(match["number"])
        return Bounds(number, number, match["unit"].strip())
    raise ValueError(f"expected a number with a unit, '< x', '> x' or '[x .. y]', got {text!r}")


def in_unit(limits: Bounds, unit: str, unit_type: str) -> Bounds:
    """The same bounds in another unit; ValueError for a unit of another type."""
    return replace(
        limits,
        low=converted(limits.low, limits.unit, unit, unit_type),
        high=converted(limits.high, limits.unit, unit, unit_type),
        unit=unit,
    )


def converted(number: float, unit: str, wanted: str, unit_type: str) -> float:
    """A number in the wanted unit; ValueError for a unit that the type does not have."""
    units = UNITS.get(unit_type, {wanted: (1.0, 0.0)} if unit == wanted else {})
    for name in (unit, wanted):
        if name not in units:
            expected = nearest(name, units) if units else f"; {unit_type} has one unit, {wanted}"
            raise ValueError(f"{name!r} is not a unit of {unit_type}{expected}")
    if unit == wanted:
        return number
    (scale, offset), (to, shift) = units[unit], units[wanted]
    return float(f"{(number * scale + offset - shift) / to:.{DIGITS}g}")
