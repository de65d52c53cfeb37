"""Temporal categories: conditions over a sequence of frames (outlook of Cheng et al.).

For example: rain, and then sun within five seconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Protocol

import numpy as np

from pipeline.core.constraint_language import read_constraint
from pipeline.core.constraints import Bools, Clause
from pipeline.core.space import Space
from pipeline.core.variable import Floats, Ints

UNKNOWN = -1
NEVER = np.iinfo(np.int64).max
RESOLUTION_S = 1e-6
"""Resolution of times; the differences of times are rounded, by less."""


@dataclass(frozen=True)
class Frames:
    """The frames of sequences, those of a sequence together and in order of time.

    Args:
        categories: (n, d) category indices, -1 for unknown.
        time_s: (n,) rising within a sequence.
        sequence: (n,) rising, from 0 to `count` - 1, each at least once.
        count: number of sequences.
    """

    categories: Ints
    time_s: Floats
    sequence: Ints
    count: int

    def any(self, holds: Bools) -> Bools:
        """(count,) whether each sequence has a frame in which `holds`, (n,), is true."""
        return np.asarray(np.bincount(self.sequence, holds, self.count) > 0)

    def first(self, holds: Bools) -> Ints:
        """(count,) position of the first frame in which `holds`, (n,), is true, or `NEVER`."""
        first = np.full(self.count, NEVER)
        places = np.flatnonzero(holds)[::-1]
        first[self.sequence[places]] = places
        return first


@dataclass(frozen=True)
class Condition:
    """A text of the constraint language over the variables of a frame.

    Raises:
        ValueError: the text is wrong, never holds, or always holds.
    """

    text: str
    space: Space

    def __post_init__(self) -> None:
        if not self._clauses:
            raise ValueError(f"'{self.text}' holds in every frame")

    @cached_property
    def _clauses(self) -> tuple[Clause, ...]:
        return read_constraint(self.text, self.space.variables)

    def holds(self, categories: Ints, unknown: bool) -> Bools:
        """(n,) whether it holds in each frame.

        Args:
            categories: (n, d) category indices, -1 for unknown.
            unknown: whether an unknown category satisfies a literal. With True, the result says
                where no clause is broken. With False, where the condition holds whatever the
                unknown categories are; a condition with several clauses may also hold elsewhere.
        """
        result = np.ones(len(categories), dtype=bool)
        for clause in self._clauses:
            satisfied = np.zeros(len(categories), dtype=bool)
            for literal in clause:
                column = categories[:, literal.variable]
                equals = (column == literal.category) == literal.equal
                satisfied |= np.where(column < 0, unknown, equals)
            result &= satisfied
        return result


class Rule(Protocol):
    """Computes a category of each sequence."""

    @property
    def labels(self) -> tuple[str, ...]:
        """The categories' names."""
        ...

    def outcomes(self, frames: Frames) -> Ints:
        """(count,) category of each sequence, -1 where unknown frames leave it open."""
        ...


@dataclass(frozen=True)
class Then:
    """Whether a condition holds in a frame, and another in a frame at most `within_s` s later."""

    first: Condition
    then: Condition
    within_s: float
    labels = ("no", "yes")

    def outcomes(self, frames: Frames) -> Ints:
        certain = self._holds(frames, unknown=False)
        return np.where(certain, 1, np.where(self._holds(frames, unknown=True), UNKNOWN, 0))

    def _holds(self, frames: Frames, unknown: bool) -> Bools:
        first = self.first.holds(frames.categories, unknown)
        then = self.then.holds(frames.categories, unknown)
        # The nearest earlier frame in which the first condition holds is the last one so far.
        last = np.maximum.accumulate(np.where(first, np.arange(len(first)), -1))
        before = np.concatenate([[-1], last])[: len(last)]
        same = (before >= 0) & (frames.sequence[before] == frames.sequence)
        near = frames.time_s - frames.time_s[before] <= self.within_s + RESOLUTION_S
        return frames.any(same & near & then)


@dataclass(frozen=True)
class Course:
    """How a variable with cuts changes over a sequence; a change counts when it passes a cut."""

    variable: int
    labels = ("steady", "rising", "falling", "both")

    def outcomes(self, frames: Frames) -> Ints:
        column = frames.categories[:, self.variable]
        observed = column >= 0
        level, sequence = column[observed], frames.sequence[observed]
        # Shifted levels are higher, or lower, than those of all earlier sequences, so that the
        # extremes so far begin anew with each sequence.
        apart = sequence * (column.max(initial=0) + 1)
        rises = level - apart > np.minimum.accumulate(level - apart)
        falls = level + apart < np.maximum.accumulate(level + apart)
        outcome = np.zeros(frames.count, dtype=np.int64)
        for changes, code in ((rises, 1), (falls, 2)):
            outcome += code * (np.bincount(sequence, changes, frames.count) > 0)
        return np.where(frames.any(~observed) & (outcome < 3), UNKNOWN, outcome)


@dataclass(frozen=True)
class Order:
    """Which of two conditions holds first in a sequence."""

    first: Condition
    second: Condition
    labels = (
        "neither",
        "first alone",
        "second alone",
        "first before second",
        "second before first",
        "together",
    )

    def outcomes(self, frames: Frames) -> Ints:
        # Unknown categories leave the first frames open; the order is known if no choice matters.
        orders = []
        for unknown in product((False, True), repeat=2):
            first = frames.first(self.first.holds(frames.categories, unknown[0]))
            second = frames.first(self.second.holds(frames.categories, unknown[1]))
            cases = [
                (first == NEVER) & (second == NEVER),
                second == NEVER,
                first == NEVER,
                first < second,
                first > second,
            ]
            orders.append(np.select(cases, range(len(cases)), len(cases)))
        return np.where((np.array(orders) == orders[0]).all(axis=0), orders[0], UNKNOWN)


@dataclass(frozen=True)
class Throughout:
    """The category of a variable that stays the same over a sequence.

    Unknown where it changes, or where a frame leaves it open.
    """

    variable: int
    labels: tuple[str, ...]

    def outcomes(self, frames: Frames) -> Ints:
        column = frames.categories[:, self.variable]
        observed = column >= 0
        low, high = np.full(frames.count, NEVER), np.full(frames.count, UNKNOWN, np.int64)
        np.minimum.at(low, frames.sequence[observed], column[observed])
        np.maximum.at(high, frames.sequence[observed], column[observed])
        return np.where((low == high) & ~frames.any(~observed), high, UNKNOWN)


@dataclass(frozen=True, kw_only=True)
class SequenceSpace(Space):
    """A space whose points are sequences of frames.

    frames: the space of a frame. rules: how each variable is computed from a sequence.
    time, sequence: columns of a table of frames; `sequence` is None if the table is one sequence.
    """

    frames: Space
    rules: Mapping[str, Rule]
    time: str
    sequence: str | None

    def points(self, frames: Frames) -> Ints:
        """(count, d) category indices of sequences, -1 for unknown."""
        return np.column_stack([self.rules[name].outcomes(frames) for name in self.names])
