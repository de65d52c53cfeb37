"""Temporal categories: conditions over a sequence of frames, such as rain and then sun within five seconds (outlook of Cheng et al.)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Protocol

import numpy as np

from pipeline.core.constraint_language import read_constraint
from pipeline.core.constraints import Bools, Clause, Literal
from pipeline.core.space import Space
from pipeline.core.variable import Floats, Ints

UNKNOWN = -1
NEVER = np.iinfo(np.int64).max
RESOLUTION_S = 1e-6
"""Resolution of times; the differences of times are rounded, by less."""


@dataclass(frozen=True)
class Frames:
    """The frames of sequences, those of a sequence together and in order of time.

    categories: (n, d), -1 for an unknown one. time_s: (n,) rising within a sequence. sequence: (n,) rising, from 0 to `count` - 1, each at
    least once.
    """

    categories: Ints
    time_s: Floats
    sequence: Ints
    count: int

    def any(self, holds: Bools) -> Bools:
        """(count,) whether something holds in some frame, (n,)."""
        return np.asarray(np.bincount(self.sequence, holds, self.count) > 0)

    def first(self, holds: Bools) -> Ints:
        """(count,) position of the first frame in which something holds, (n,); `NEVER` where there is none."""
        found = np.full(self.count, NEVER)
        places = np.flatnonzero(holds)[::-1]
        found[self.sequence[places]] = places
        return found


@dataclass(frozen=True)
class Condition:
    """A text of the constraint language over the variables of a frame; ValueError if it is wrong or never holds."""

    text: str
    space: Space

    def __post_init__(self) -> None:
        if not self._clauses:
            raise ValueError(f"'{self.text}' holds in every frame")

    @cached_property
    def _clauses(self) -> tuple[Clause, ...]:
        return read_constraint(self.text, self.space.variables)

    def certain(self, categories: Ints) -> Bools:
        """(n,) where it holds whatever the unknown categories are; a condition with several clauses may hold unnoticed."""
        return self._all(categories, unknown=False)

    def possible(self, categories: Ints) -> Bools:
        """(n,) where no clause is broken."""
        return self._all(categories, unknown=True)

    def _all(self, categories: Ints, unknown: bool) -> Bools:
        def holds(literal: Literal) -> Bools:
            column = categories[:, literal.variable]
            return np.where(column < 0, unknown, (column == literal.category) == literal.equal)

        return np.asarray(
            np.all(
                [
                    np.any([holds(literal) for literal in clause], axis=0)
                    for clause in self._clauses
                ],
                axis=0,
            )
        )


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
    """Whether one condition holds in a frame, and another in a later frame, at most `within_s` seconds later."""

    first: Condition
    then: Condition
    within_s: float
    labels = ("no", "yes")

    def outcomes(self, frames: Frames) -> Ints:
        certain = self._found(frames, Condition.certain)
        return np.where(certain, 1, np.where(self._found(frames, Condition.possible), UNKNOWN, 0))

    def _found(self, frames: Frames, where: Callable[[Condition, Ints], Bools]) -> Bools:
        places = np.arange(len(frames.time_s))
        # Of all frames before one, the last in which the first condition holds is the nearest.
        last = np.maximum.accumulate(np.where(where(self.first, frames.categories), places, -1))
        before = np.concatenate([[-1], last])[: len(last)]
        same = (before >= 0) & (frames.sequence[before] == frames.sequence)
        near = frames.time_s - frames.time_s[before] <= self.within_s + RESOLUTION_S
        return frames.any(same & near & where(self.then, frames.categories))


@dataclass(frozen=True)
class Course:
    """How a variable with cuts changes over a sequence; a change counts when it passes a cut."""

    variable: int
    labels = ("steady", "rising", "falling", "both")

    def outcomes(self, frames: Frames) -> Ints:
        column = frames.categories[:, self.variable]
        known = column >= 0
        level, sequence = column[known], frames.sequence[known]
        # Levels higher, or lower, than those of all sequences before, so that the extremes so far begin anew with each.
        apart = sequence * (column.max(initial=0) + 1)
        rises = self._per_sequence(
            level - apart > np.minimum.accumulate(level - apart), sequence, frames.count
        )
        falls = self._per_sequence(
            level + apart < np.maximum.accumulate(level + apart), sequence, frames.count
        )
        outcome = rises + 2 * falls
        return np.where(frames.any(~known) & (outcome < 3), UNKNOWN, outcome)

    @staticmethod
    def _per_sequence(holds: Bools, sequence: Ints, count: int) -> Ints:
        return (np.bincount(sequence, holds, count) > 0).astype(np.int64)


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
        ends = (Condition.certain, Condition.possible)
        first, second = (
            [frames.first(where(one, frames.categories)) for where in ends]
            for one in (self.first, self.second)
        )
        corners = np.array([self._outcome(a, b) for a, b in product(first, second)])
        return np.where((corners == corners[0]).all(axis=0), corners[0], UNKNOWN)

    @staticmethod
    def _outcome(first: Ints, second: Ints) -> Ints:
        chosen = [
            (first == NEVER) & (second == NEVER),
            second == NEVER,
            first == NEVER,
            first < second,
            first > second,
        ]
        return np.select(chosen, range(len(chosen)), len(chosen))


@dataclass(frozen=True)
class Throughout:
    """The category of a variable that stays the same over a sequence; unknown where it changes, or where a frame leaves it open."""

    variable: int
    labels: tuple[str, ...]

    def outcomes(self, frames: Frames) -> Ints:
        column = frames.categories[:, self.variable]
        known = column >= 0
        low, high = np.full(frames.count, NEVER), np.full(frames.count, UNKNOWN, np.int64)
        np.minimum.at(low, frames.sequence[known], column[known])
        np.maximum.at(high, frames.sequence[known], column[known])
        return np.where((low == high) & ~frames.any(~known), high, UNKNOWN)


@dataclass(frozen=True, kw_only=True)
class SequenceSpace(Space):
    """A space whose points are sequences of frames.

    frames: the space of a frame. rules: how each variable is computed from a sequence. time, sequence: columns of a table of frames, the
    second None if the table is one sequence.
    """

    frames: Space
    rules: Mapping[str, Rule]
    time: str
    sequence: str | None

    def points(self, frames: Frames) -> Ints:
        """(count, d) category indices of sequences, -1 for unknown."""
        return np.column_stack([self.rules[name].outcomes(frames) for name in self.names])
