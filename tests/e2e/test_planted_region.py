"""The search alone, in milliseconds a test: it finds what was planted, sooner than random testing, and says it in words."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core import kpi
from pipeline.core.growth import grow_regions
from pipeline.core.regions import NOISE, find_regions
from pipeline.core.rules import find_rule
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.neural import NeuralSampler
from pipeline.core.samplers.random import RandomSampler
from pipeline.core.space import Floats
from pipeline.detectors.scripted import BlindDetector
from pipeline.simulators.analytic import PLANTED, AnalyticSimulator
from tests.spaces import THESIS

THRESHOLD_S = 0.1
SIMULATOR = AnalyticSimulator({"space": THESIS.to_dict()})


def search(sampler: BatchSampler, tests: int) -> tuple[Floats, Floats]:
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
def searches() -> list[tuple[Floats, Floats]]:
    return [search(NeuralSampler(THESIS, seed), 160) for seed in range(4)]


def test_the_adaptive_strategy_beats_random_testing(searches: list[tuple[Floats, Floats]]) -> None:
    adaptive = [int(np.sum(values <= THRESHOLD_S)) for _, values in searches]
    random = [int(np.sum(search(RandomSampler(THESIS, seed), 160)[1] <= THRESHOLD_S)) for seed in range(4)]
    assert sum(adaptive) > 1.5 * sum(random)
    assert all(a > r for a, r in zip(adaptive, random, strict=True))


def test_the_regions_that_are_found_are_the_planted_ones(searches: list[tuple[Floats, Floats]]) -> None:
    points = np.concatenate([points for points, _ in searches])
    failures = np.concatenate([values for _, values in searches]) <= THRESHOLD_S
    labels = np.full(len(points), NOISE, np.int64)
    labels[failures] = find_regions(THESIS, points[failures], 0.16, 4)
    grown = grow_regions(THESIS, points, failures, labels, 0.6, 4)
    planted = SIMULATOR.planted(points)
    assert grown.max() >= 1
    found = set()
    for label in range(2):
        members = grown == label
        causes, counts = np.unique(planted[members], return_counts=True)
        # One region, one cause.
        assert counts.max() / counts.sum() > 0.8
        cause = PLANTED[int(causes[np.argmax(counts)])]
        found.add(cause.name)
        rule = find_rule(THESIS, points, failures, members)
        named = {THESIS.names[condition.variable] for condition in rule.conditions}
        assert named & {*cause.intervals, *cause.values}
        inside = rule.holds(points)
        assert failures[inside].mean() > 2 * failures.mean()
    assert len(found) == 2
