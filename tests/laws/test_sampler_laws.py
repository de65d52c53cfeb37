"""Replaying a journal, in portions of any length, equals never having been interrupted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.core.constraints import parse_constraints
from pipeline.core.coverage.projection import projection_coverage
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.coverage import CoverageSampler
from pipeline.core.samplers.neural import NeuralSampler
from pipeline.core.samplers.pairwise import PairwiseSampler
from pipeline.core.samplers.random import RandomSampler
from pipeline.core.space import Floats, Space
from tests.spaces import SMALL

pytestmark = pytest.mark.usefixtures("short_annealing")

BATCH = 6


def kpi_of(points: Floats) -> Floats:
    """Lower towards high x; one test in seven breaks the simulation."""
    values = 1.05 - points[:, 0] / 10
    return np.where(np.arange(len(points)) % 7 == 3, np.nan, values)


def taught(space: Space, seed: int, **settings: Any) -> NeuralSampler:
    """The neural strategy with tests of another scenario."""
    points = space.sample(20, np.random.default_rng(7))
    return NeuralSampler(space, seed, earlier=[(points, kpi_of(points))], **settings)


SAMPLERS: list[Callable[..., BatchSampler]] = [RandomSampler, NeuralSampler, taught, PairwiseSampler, CoverageSampler]


def run(sampler: BatchSampler, batches: int) -> tuple[Floats, Floats]:
    points, kpi = np.zeros((0, len(SMALL))), np.zeros(0)
    for _ in range(batches):
        asked = sampler.ask()
        values = kpi_of(asked)
        sampler.tell(asked, values)
        points, kpi = np.concatenate([points, asked]), np.concatenate([kpi, values])
    return points, kpi


@pytest.mark.parametrize("make", SAMPLERS)
@pytest.mark.parametrize("portion", [1, 4, 13])
def test_replay_in_portions_restores_the_sampler(make: Callable[..., BatchSampler], portion: int) -> None:
    points, kpi = run(make(SMALL, 3, batch_size=BATCH), 7)
    for told in (0, 2, BATCH, 3 * BATCH + 5, 6 * BATCH):
        restored = make(SMALL, 3, batch_size=BATCH)
        for start in range(0, told, portion):
            end = min(start + portion, told)
            restored.tell(points[start:end], kpi[start:end])
        # In the middle of a batch the rest of it is asked.
        end = (told // BATCH + 1) * BATCH
        assert np.array_equal(restored.ask(), points[told:end])


@pytest.mark.parametrize("make", SAMPLERS)
def test_seeds_differ_and_the_same_seed_does_not(make: Callable[..., BatchSampler]) -> None:
    first, same, other = (run(make(SMALL, seed, batch_size=BATCH), 3)[0] for seed in (1, 1, 2))
    assert np.array_equal(first, same) and not np.array_equal(first, other)


@pytest.mark.parametrize("make", SAMPLERS)
def test_constraints_are_kept(make: Callable[..., BatchSampler]) -> None:
    constraints = parse_constraints(SMALL, [["kind != a", "count = 1"], ["x != 10"]])
    points, _ = run(make(SMALL, 0, batch_size=BATCH, constraints=constraints), 5)
    assert constraints.holds(SMALL.categorise(points)).all()


@pytest.mark.parametrize("make", SAMPLERS)
def test_a_history_of_broken_simulations_is_survived(make: Callable[..., BatchSampler]) -> None:
    sampler = make(SMALL, 0, batch_size=BATCH)
    for _ in range(3):
        asked = sampler.ask()
        sampler.tell(asked, np.full(len(asked), np.nan))
    assert np.isfinite(sampler.ask()).all()


def test_what_other_scenarios_have_shown_guides_the_first_batch() -> None:
    first, blind = taught(SMALL, 0, batch_size=40).ask(), NeuralSampler(SMALL, 0, batch_size=40).ask()
    assert first[:, 0].mean() > blind[:, 0].mean() + 1  # The KPI falls with x.


def test_the_pairwise_plan_comes_first_and_random_tests_after_it() -> None:
    sampler = PairwiseSampler(SMALL, 0, batch_size=50)
    points, _ = run(sampler, 3)
    rows = len(sampler.plan)
    assert rows < 150 and np.array_equal(points[:rows], sampler.plan)
    assert not np.array_equal(points[rows:], SMALL.representatives(SMALL.categorise(points[rows:])))


def test_coverage_covers_all_pairs_sooner_than_chance_and_then_all_of_them_twice() -> None:
    guided, _ = run(CoverageSampler(SMALL, 0, batch_size=20), 14)
    drawn, _ = run(RandomSampler(SMALL, 0, batch_size=20), 14)

    def ratio(points: Floats, wanted: int) -> float:
        weights = [np.full(size, wanted) for size in SMALL.sizes]
        return projection_coverage(SMALL.categorise(points), SMALL.sizes, 2, weights=weights, combine="max").ratio

    full = next(n for n in range(len(guided)) if ratio(guided[:n], 1) == 1)
    assert full <= 170 and ratio(drawn[:full], 1) < 0.9  # 11 x 12 rows are needed.
    assert ratio(guided, 2) > ratio(drawn, 2)
    assert len(np.unique(guided[:, 0])) == len(guided)  # Values are drawn inside their categories.


@pytest.mark.parametrize("make", SAMPLERS)
def test_wrong_arguments_are_named(make: Callable[..., BatchSampler]) -> None:
    with pytest.raises(ValueError, match="batch_size must be at least 1, got 0"):
        make(SMALL, 0, batch_size=0)
    with pytest.raises(ValueError, match="seed must be at least 0, got -1"):
        make(SMALL, -1)
    with pytest.raises(ValueError, match=r"points must have shape \(2, 4\), got \(1, 4\)"):
        make(SMALL, 0).tell(np.zeros((1, 4)), np.zeros(2))
