"""The worlds in which strategies search, and which of them development may use."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Protocol

import recorded
from analytic import AnalyticWorld
from emulators import FAMILIES, EmulatedWorld, Emulator

from pipeline.config.composing import compose, functional_scenario
from pipeline.config.schema import Config
from pipeline.core.space import Floats, Space
from pipeline.scenarios.functional import FunctionalScenario
from pipeline.simulators.analytic import AnalyticSimulator
from pipeline.sources import code_digest

ANALYTIC = "analytic"
RARITIES: dict[str, float | None] = {"": None, "-rare": 0.015, "-rarest": 0.001}
"""Share of random tests that fail; None: as recorded."""
GROUPS = (ANALYTIC, *(f"{family}{rarity}" for rarity in RARITIES for family in FAMILIES))


class World(Protocol):
    """Something to search in, without rendering."""

    space: Space

    def kpi(self, points: Floats) -> Floats:
        """(n, d) points to (n,) seconds, NaN for an error; it depends on the points alone."""
        ...


@dataclass(frozen=True)
class Split:
    """Scenarios and seeds for one use."""

    scenarios: tuple[str, ...]
    first_seed: int

    def seeds(self, count: int) -> range:
        return range(self.first_seed, self.first_seed + count)


SPLITS = {"development": Split(("F2", "F3"), 100), "judging": Split(("F1", "F5", "F8"), 0)}
"""Strategies and their settings are chosen on the first alone; only the second is published."""


@dataclass(frozen=True)
class WorldName:
    """A scenario in a group of worlds: `trees-rare` is a family of emulators and a rarity. As text, `F1-trees-rare`."""

    scenario: str
    group: str

    def __str__(self) -> str:
        return f"{self.scenario}-{self.group}"

    @staticmethod
    def parse(text: str) -> WorldName:
        scenario, _, group = text.partition("-")
        return WorldName(scenario, group)

    @property
    def family(self) -> str:
        return self.group.partition("-")[0]

    @property
    def share(self) -> float | None:
        return RARITIES[self.group.removeprefix(self.family)]


def names(split: str, groups: Iterable[str]) -> list[WorldName]:
    """The worlds of a split. The analytic world is one, in the space of F1: its regions are in the source for all to read."""
    found = []
    for group in groups:
        scenarios = ("F1",) if group == ANALYTIC else SPLITS[split].scenarios
        found += [WorldName(scenario, group) for scenario in scenarios]
    return found


@lru_cache(maxsize=4)
def make(name: WorldName, seed: int, folder: Path = recorded.DENSE) -> World:
    """A world; the seed draws the chance of emulated tests. folder: of the recorded tests. InputError if they are missing."""
    threshold_s = default_study().campaign.failure_threshold_s
    if name.group == ANALYTIC:
        return AnalyticWorld(_scenario(name.scenario), default_study().car, threshold_s)
    return EmulatedWorld(
        _emulator(name.scenario, name.family, folder), seed, name.share, threshold_s
    )


def digest(name: WorldName, folder: Path = recorded.DENSE) -> str:
    """Text that changes with what a world is made from; InputError if its recorded tests are missing."""
    return (
        code_digest(AnalyticSimulator.__module__)
        if name.group == ANALYTIC
        else recorded.digest(name.scenario, folder)
    )


@cache
def default_study() -> Config:
    return compose("default", [])


@cache
def _emulator(scenario: str, family: str, folder: Path) -> Emulator:
    return Emulator(family, recorded.read(scenario, _scenario(scenario).logical_space(), folder))


@cache
def _scenario(name: str) -> FunctionalScenario:
    return functional_scenario(name)
