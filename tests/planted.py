"""Worlds with planted failure regions, in the space of the thesis with real people."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.core.grouping import Outcomes
from pipeline.core.rules import Bools, Condition, Rule
from pipeline.core.space import Floats, Space, Variable
from pipeline.scenarios import people
from tests.spaces import THESIS

SPACE = Space((*THESIS.variables[:-1], Variable.from_dict(people.VARIABLE, people.variable(1))))
"""The space of the thesis with the people of population 1."""
RAIN, FOG, AZIMUTH, ALTITUDE, SHIFT, SPEED, POSE, PERSON = range(len(SPACE))
_ATTRIBUTES = {name: np.array(numbers) for name, numbers in SPACE.variables[PERSON].attributes}
CHILDREN = tuple(np.flatnonzero(_ATTRIBUTES["height_m"] <= 1.4).tolist())
UMBRELLAS = tuple(np.flatnonzero(_ATTRIBUTES["umbrella"] == 1).tolist())
CROUCHING = (SPACE.variables[POSE].values.index("crouching"),)


@dataclass(frozen=True)
class Band:
    """Where rain and fog differ by at most so many percent: a diagonal, which no box describes."""

    percent: float

    def holds(self, points: Floats) -> Bools:
        """Which points (n, d) it admits, as (n,)."""
        return np.asarray(np.abs(points[:, RAIN] - points[:, FOG]) <= self.percent)


@dataclass(frozen=True)
class World:
    """A world with planted failures.

    boxes: every test inside one fails. tests: number of random ones. noise: share of the tests with
    a wrong outcome.
    """

    boxes: tuple[Rule | Band, ...]
    texts: tuple[str, ...] = ()
    tests: int = 400
    noise: float = 0.0

    def outcomes(self, seed: int) -> Outcomes:
        """Random tests of the world."""
        rng = np.random.default_rng(seed)
        points = SPACE.sample(self.tests, rng)
        return Outcomes(
            SPACE, points, self.fails(points) ^ (rng.random(self.tests) < self.noise), people.WORDS
        )

    def fails(self, points: Floats) -> Bools:
        """Which points (n, d) lie in a planted region, as (n,)."""
        return np.asarray(np.any([box.holds(points) for box in self.boxes], axis=0))


_FOG_AT_NIGHT = Rule((Condition(FOG, 60, 100), Condition(ALTITUDE, -20, 0)))
_RUNNING_IN_RAIN = Rule((Condition(RAIN, 70, 100), Condition(SPEED, 2, 3)))
WORLDS: Mapping[str, World] = {
    "two boxes": World((_FOG_AT_NIGHT, _RUNNING_IN_RAIN)),
    "two noisy boxes": World((_FOG_AT_NIGHT, _RUNNING_IN_RAIN), noise=0.04, tests=800),
    "through north": World(
        (Rule((Condition(AZIMUTH, 330, 30),)),), ("sun_azimuth from 330 through 360 to 30 deg",)
    ),
    "a thin slab": World(
        (Rule((Condition(ALTITUDE, -2, 4), Condition(SPEED, 0, 0.8))),), tests=1600
    ),
    "a diagonal": World((Band(12),), ("rain - fog in [-1",)),
    "a category": World((Rule((Condition(POSE, values=CROUCHING),)),), ("crouching",)),
    "an attribute": World(
        (Rule((Condition(RAIN, 40, 100), Condition(PERSON, values=CHILDREN))),),
        ("child and rain >= ",),
        tests=800,
    ),
    "two words": World(
        (Rule((Condition(POSE, values=CROUCHING), Condition(PERSON, values=UMBRELLAS))),),
        ("crouching under an umbrella",),
    ),
    "people who share nothing": World(
        (Rule((Condition(PERSON, values=(3, 40, 71)),)),), ("blueprint in {W 04, M 04, M 35}",)
    ),
}
"""Worlds of boxes. texts: of their rules, or how they begin."""


def overlap(space: Space, first: Rule, second: Rule | Band) -> float:
    """Share of the points in either rule that lie in both, estimated from 40,000 random points."""
    points = space.sample(40_000, np.random.default_rng(99))
    a, b = first.holds(points), second.holds(points)
    return float((a & b).sum() / max(1, (a | b).sum()))
