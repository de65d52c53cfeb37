"""The search alone, at milliseconds per test: it finds the planted regions, sooner than random testing, with readable rules."""

from __future__ import annotations

import numpy as np
import pytest
from hydra.utils import instantiate

from pipeline.config.composing import compose
from pipeline.core import kpi
from pipeline.core.growth import PointOutcomes, readable_regions
from pipeline.core.regions import chance_radius
from pipeline.core.rules import find_rule
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.neural import NeuralSampler
from pipeline.core.samplers.random import RandomSampler
from pipeline.core.space import Floats
from pipeline.detectors.scripted import BlindDetector
from pipeline.simulators.analytic import PLANTED, AnalyticSimulator
from pipeline.testing import CAR
from tests.scenarios import scenario_with
from tests.spaces import THESIS

THRESHOLD_S = 0.1
CHANCE_NEIGHBOURS, MIN_FAILURES, MIN_PRECISION = 0.5, 4, 0.75
Search = tuple[Floats, Floats]
SIMULATOR = AnalyticSimulator(scenario_with(THESIS), CAR)


def search(sampler: BatchSampler, tests: int) -> Search:
    """Points and KPIs of the first `tests` tests of a strategy."""
    points, values = np.zeros((0, len(THESIS))), np.zeros(0)
    while len(points) < tests:
        asked = sampler.ask()
        signals = [SIMULATOR.execute(THESIS.decode(point), BlindDetector()).signals for point in asked]
        told = np.array([kpi.evaluate(columns, THRESHOLD_S).adj_ttc_s for columns in signals])
        sampler.tell(asked, told)
        points, values = np.concatenate([points, asked]), np.concatenate([values, told])
    return points[:tests], values[:tests]


@pytest.fixture(scope="module")
def adaptive_searches() -> list[Search]:
    return [search(NeuralSampler(THESIS, seed), 160) for seed in range(4)]


@pytest.fixture(scope="module")
def random_searches() -> list[Search]:
    return [search(RandomSampler(THESIS, seed), 160) for seed in range(4)]


def test_the_adaptive_strategy_beats_random_testing(adaptive_searches: list[Search], random_searches: list[Search]) -> None:
    adaptive = [int(np.sum(values <= THRESHOLD_S)) for _, values in adaptive_searches]
    random = [int(np.sum(values <= THRESHOLD_S)) for _, values in random_searches]
    assert sum(adaptive) > 1.5 * sum(random)
    assert all(a > r for a, r in zip(adaptive, random, strict=True))


def test_the_shipped_settings_suit_short_campaigns(
    adaptive_searches: list[Search],
) -> None:
    section = compose("default", []).samplers["neural"]
    shipped = [search(instantiate(section, _partial_=True)(THESIS, seed), 160) for seed in range(4)]
    assert sum(map(kinds, shipped)) > 1.3 * sum(map(kinds, adaptive_searches))


def test_a_common_cause_does_not_take_every_batch() -> None:
    """Three blueprints always fail, everybody else only limping at night: sharing batches between kinds gives the three fewer tests."""

    def commonest(kinds: int, seed: int) -> int:
        sampler = NeuralSampler(THESIS, seed, epsilon=0.25, omega_threshold=-3, spread=0.2, kinds=kinds)
        found = 0
        for _ in range(6):
            points = sampler.ask()
            named = {variable.name: points[:, j] for j, variable in enumerate(THESIS.variables)}
            common = named["blueprint"] < 3
            sampler.tell(points, np.where(common | ((named["animation"] < 1) & (named["sun_altitude"] < 0)), 0.0, 1.0))
            found += int(common.sum())
        return found

    alone, shared = (sum(commonest(kinds, seed) for seed in range(4)) for kinds in (1, 6))
    assert shared < 0.7 * alone


def test_earlier_campaigns_reveal_a_rare_cause() -> None:
    """Two of 74 blueprints always fail: four campaigns of 80 tests find few unless they learn from each other."""

    def kpi_of(points: Floats) -> Floats:
        return np.where(points[:, THESIS.names.index("blueprint")] < 2, 0.0, 1.0)

    def failures(transfer: bool, seed: int) -> int:
        earlier: list[Search] = []
        count = 0
        for campaign in range(4):
            sampler = NeuralSampler(
                THESIS,
                10 * seed + campaign,
                epsilon=0.25,
                omega_threshold=-3,
                spread=0.2,
                kinds=6,
                earlier=earlier,
            )
            asked = []
            for _ in range(4):
                asked.append(sampler.ask())
                sampler.tell(asked[-1], kpi_of(asked[-1]))
            points = np.concatenate(asked)
            count += int(np.sum(kpi_of(points) <= THRESHOLD_S))
            if transfer:
                earlier.append((points, kpi_of(points)))
        return count

    alone, knowing = (sum(failures(transfer, seed) for seed in range(2)) for transfer in (False, True))
    assert knowing > 1.5 * alone


def kinds(found: Search) -> int:
    """Combinations of categories in which tests failed."""
    points, values = found
    categorical = [j for j, variable in enumerate(THESIS.variables) if variable.kind == "categorical"]
    return len(np.unique(points[values <= THRESHOLD_S][:, categorical], axis=0))


def test_each_region_is_one_planted_cause(adaptive_searches: list[Search], random_searches: list[Search]) -> None:
    """At the default study's size: 80 tests of each strategy for each of two seeds."""
    used = [*adaptive_searches[:2], *random_searches[:2]]
    points = np.concatenate([points[:80] for points, _ in used])
    failures = np.concatenate([values[:80] for _, values in used]) <= THRESHOLD_S
    radius = chance_radius(THESIS, int(failures.sum()), CHANCE_NEIGHBOURS)
    labels = readable_regions(PointOutcomes(THESIS, points, failures), radius, MIN_PRECISION, MIN_FAILURES)
    planted, found = SIMULATOR.planted(points), set()
    for label in range(labels.max() + 1):
        counts = np.bincount(planted[labels == label], minlength=len(PLANTED))
        # Not all of them: planted regions overlap, and in the overlap both causes hold.
        assert counts.max() / counts.sum() > 0.75
        cause = PLANTED[int(np.argmax(counts))]
        found.add(cause.name)
        rule = find_rule(THESIS, points, failures, labels == label)
        named = {THESIS.names[condition.variable] for condition in rule.conditions}
        assert named & {*cause.intervals, *cause.values}
        assert failures[rule.holds(points)].mean() >= MIN_PRECISION
    assert len(found) >= 2
