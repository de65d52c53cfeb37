"""Changes of a test that may fix its failure: milder conditions, another person, no occluder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.core.grouping import Outcomes
from pipeline.core.rules import Bools
from pipeline.core.space import Floats, Space, Value, Variable
from pipeline.scenarios import people
from pipeline.scenarios.functional import FunctionalScenario

WEATHER = ("rain", "fog", "sun_azimuth", "sun_altitude")
"""The variables that `clear weather by day` sets together."""
CLEAR = "clear weather by day"
NOISE = "other noise"
"""The control: nothing changes but the random numbers, such as the camera's grain."""


@dataclass(frozen=True)
class Change:
    """A change of a test; without values and actors it is the control, a test with other noise.

    text: as in `no rain repairs 3 of 20`. values: new values by variable. without: actors that are
    removed.
    """

    text: str
    values: Mapping[str, Value] = field(default_factory=dict)
    without: tuple[str, ...] = ()

    @property
    def is_control(self) -> bool:
        return not self.values and not self.without

    @property
    def is_single(self) -> bool:
        """Whether it changes one variable alone, or removes actors."""
        return len(self.values) + bool(self.without) == 1

    def of(self, concrete: Mapping[str, Value], space: Space) -> dict[str, Value] | None:
        """The changed concrete scenario; None if it breaks a constraint of the space."""
        changed = {**concrete, **self.values}
        point = np.array([variable.encode(changed[variable.name]) for variable in space.variables])
        return changed if space.violation(point[None]) is None else None


CONTROL = Change(NOISE)


def ranked(repaired: Sequence[tuple[Change, float]]) -> list[Change]:
    """Changes by the share of failures that each repairs, best first; single changes first.

    A repair by fewer changes says more about its cause.
    """
    ordered = sorted(repaired, key=lambda item: (not item[0].is_single, -item[1]))
    return [change for change, _ in ordered]


def changes(tests: Outcomes, members: Bools) -> tuple[Change, ...]:
    """Each variable at its mildest value, alone, then clear weather as a whole.

    The mildest value is the declared one. A categorical variable without one, such as the person,
    takes the value with the lowest failure rate in the tests, see `best_known`. Other numbers are
    not changed.

    Args:
        tests: all tests.
        members: (n,) the failures to repair.
    """
    single = tuple(_single(tests, members))
    weather: dict[str, Value] = {}
    for change in single:
        for name, value in change.values.items():
            if name in WEATHER:
                weather[name] = value
    return (*single, Change(CLEAR, weather)) if len(weather) > 1 else single


def without(scenario: FunctionalScenario, actors: Sequence[str]) -> tuple[Change, ...]:
    """The removal of some actors of a scenario; nothing without actors."""
    if not actors:
        return ()
    described = []
    for name in actors:
        words, kind = name.replace("_", " "), scenario.actors[name].kind
        # `the bus`, or `the approaching hatchback`.
        described.append(f"the {words}" if kind in words else f"the {words} {kind}")
    return (Change(f"without {' and '.join(described)}", without=tuple(actors)),)


def best_known(column: Floats, failed: Bools, size: int) -> int:
    """The value of a categorical variable with the lowest failure rate; the first of several.

    A further test, which fails as often as all do, counts for each value: few tests show little.

    Args:
        column: (n,) encoded values.
        failed: (n,) whether each test failed.
        size: number of values.
    """
    tests = np.bincount(column.astype(np.int64), minlength=size)
    failures = np.bincount(column.astype(np.int64), weights=failed, minlength=size)
    return int(np.argmin((failures + failed.mean()) / (tests + 1)))


def _single(tests: Outcomes, members: Bools) -> Iterator[Change]:
    for index, variable in enumerate(tests.space.variables):
        column = tests.points[:, index]
        if variable.mild is not None:
            value = variable.decode(variable.mild)
            yield Change(_text(variable, value), {variable.name: value})
        elif variable.kind == "categorical" and variable.size > 1:
            best = best_known(column, tests.failed, variable.size)
            value = variable.decode(best)
            text = _text(variable, value)
            if variable.name == people.VARIABLE:
                text = _person(variable, best, column[members])
            yield Change(text, {variable.name: value})


def _text(variable: Variable, value: Value) -> str:
    """`no rain`, `sun altitude 60 deg` or `walking`."""
    name = variable.name.replace("_", " ")
    if isinstance(value, str):
        for word in people.WORDS:
            if (word.variable, word.value) == (variable.name, value):
                return word.text
        return f"{name} {value}"
    if value == 0 and variable.unit == "%":
        return f"no {name}"
    return f"{name} {value:g} {variable.unit}".rstrip()


def _person(variable: Variable, best: int, failing: Floats) -> str:
    """`another person (W 01)`, or `a taller person` if nine in ten of the failing are smaller.

    failing: (n,) encoded.
    """
    text, heights = "another", dict(variable.attributes).get("height_m")
    if heights is not None:
        smaller = np.array(heights)[failing.astype(np.int64)] < heights[best]
        if np.mean(smaller) >= 0.9:
            text = "a taller"
    return f"{text} person ({variable.values[best]})"
