"""Replaying a journal, in portions of any length, equals an uninterrupted run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.coverage.projection import Demand, projection_coverage
from pipeline.core.measures import pair_coverage
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.coverage import CoverageSampler
from pipeline.core.samplers.forest import ForestSampler
from pipeline.core.samplers.mixed import MixedSampler
from pipeline.core.samplers.pairwise import PairwiseSampler
from pipeline.core.samplers.random import RandomSampler
from pipeline.core.space import Floats, Space, Variable
from tests.spaces import CONSTRAINED, CUT, SMALL
from tests.strategies import Strategy, kpi_of, strategies

pytestmark = pytest.mark.usefixtures("short_annealing")

BATCH = 6
EVERY = pytest.mark.parametrize("make", strategies().values(), ids=strategies().keys())


def run(sampler: BatchSampler, batches: int) -> tuple[Floats, Floats]:
    points, kpi = np.zeros((0, len(sampler.space))), np.zeros(0)
    for _ in range(batches):
        asked = sampler.ask()
        values = kpi_of(asked)
        sampler.tell(asked, values)
        points, kpi = np.concatenate([points, asked]), np.concatenate([kpi, values])
    return points, kpi


@EVERY
@pytest.mark.parametrize("portion", [1, 4, 13])
def test_replay_in_portions_restores_the_sampler(make: Strategy, portion: int) -> None:
    points, kpi = run(make(SMALL, 3, batch_size=BATCH), 7)
    for count in (0, 2, BATCH, 3 * BATCH + 5, 6 * BATCH):
        restored = make(SMALL, 3, batch_size=BATCH)
        for start in range(0, count, portion):
            end = min(start + portion, count)
            restored.tell(points[start:end], kpi[start:end])
        # In the middle of a batch `ask` returns the rest.
        end = (count // BATCH + 1) * BATCH
        assert np.array_equal(restored.ask(), points[count:end])


@EVERY
def test_only_different_seeds_give_different_points(make: Strategy) -> None:
    first, same, other = (run(make(SMALL, seed, batch_size=BATCH), 3)[0] for seed in (1, 1, 2))
    assert np.array_equal(first, same) and not np.array_equal(first, other)


@EVERY
@pytest.mark.parametrize("seed", range(3))
def test_constraints_are_kept(make: Strategy, seed: int) -> None:
    points, _ = run(make(CONSTRAINED, seed, batch_size=BATCH), 5)
    assert CONSTRAINED.violation(points) is None


@EVERY
def test_parts_between_cuts_are_sampled_like_a_grid(make: Strategy) -> None:
    points, _ = run(make(CUT, 0, batch_size=BATCH), 5)
    assert all(
        np.array_equal(CUT.encode(CUT.decode(point)), point) for point in points
    )  # `encode` rejects values outside the space.


@EVERY
def test_samplers_survive_a_history_of_errors(make: Strategy) -> None:
    sampler = make(SMALL, 0, batch_size=BATCH)
    for _ in range(3):
        asked = sampler.ask()
        sampler.tell(asked, np.full(len(asked), np.nan))
    assert np.isfinite(sampler.ask()).all()


def test_results_of_other_scenarios_guide_the_first_batch() -> None:
    earlier = SMALL.sample(20, np.random.default_rng(7))
    taught = ForestSampler(SMALL, 0, batch_size=40, earlier=[(earlier, kpi_of(earlier))])
    first, blind = taught.ask(), ForestSampler(SMALL, 0, batch_size=40).ask()
    assert first[:, 0].mean() > blind[:, 0].mean() + 1  # The KPI falls with x.


def test_pairs_that_the_constraints_exclude_are_neither_explored_nor_missed_among_failures() -> (
    None
):
    tested = CONSTRAINED.sample(5000, np.random.default_rng(0))
    assert pair_coverage(CONSTRAINED, tested) == 1
    asked = []
    for explore in (0, 1):
        sampler = ForestSampler(CONSTRAINED, 0, explore=explore, explore_until=1)
        sampler.tell(tested, kpi_of(tested))
        asked.append(sampler.ask())
    assert np.array_equal(asked[0], asked[1])
    assert sampler._worth(sampler._shown(tested)) == sampler.exploitation


@pytest.mark.parametrize("uniform", [0.0, 0.3, 0.5, 1.0])
def test_a_mixture_draws_its_share_at_random_and_guides_the_rest(uniform: float) -> None:
    samplers = [MixedSampler(SMALL, 0, batch_size=10, uniform=uniform) for _ in range(2)]
    first = samplers[0].ask()
    low, high = (np.where(np.arange(10) % 2 == i, -1.0, 1.0) for i in range(2))
    asked = []
    for sampler, kpi in zip(samplers, (low, high), strict=True):
        sampler.tell(first, kpi)
        asked.append(sampler.ask())
    drawn = round(uniform * 10)
    assert np.array_equal(asked[0][:drawn], asked[1][:drawn])
    assert drawn == 10 or not np.array_equal(asked[0][drawn:], asked[1][drawn:])


def test_a_mixture_that_is_not_told_attributes_searches_as_if_there_were_none() -> None:
    nameless = Variable("person", "categorical", values=tuple("abcde"))
    heights = replace(nameless, attributes=(("height_m", (1.0, 1.1, 1.7, 1.8, 1.9)),))
    asked: dict[tuple[bool, bool], Floats] = {}
    for person, informed in ((heights, True), (heights, False), (nameless, False)):
        sampler = MixedSampler(
            Space((person, *SMALL.variables)), 0, batch_size=20, uniform=0.0, attributes=informed
        )
        points = sampler.ask()
        sampler.tell(points, np.where(points[:, 0] < 2, -1.0, 1.0))
        asked[person is heights, informed] = sampler.ask()
    assert np.array_equal(asked[True, False], asked[False, False])
    assert not np.array_equal(asked[True, True], asked[True, False])


def test_the_pairwise_plan_comes_first_and_random_tests_after_it() -> None:
    sampler = PairwiseSampler(SMALL, 0, batch_size=50)
    points, _ = run(sampler, 3)
    rows = len(sampler.plan)
    assert rows < 150 and np.array_equal(points[:rows], sampler.plan)
    assert not np.array_equal(points[rows:], SMALL.representatives(SMALL.categorise(points[rows:])))


def test_coverage_covers_all_pairs_sooner_than_random_and_then_all_twice() -> None:
    guided, _ = run(CoverageSampler(SMALL, 0, batch_size=20), 14)
    drawn, _ = run(RandomSampler(SMALL, 0, batch_size=20), 14)

    def ratio(points: Floats, wanted: int) -> float:
        weights = [np.full(size, wanted) for size in SMALL.sizes]
        return projection_coverage(
            SMALL.categorise(points), Demand(SMALL.constraints, 2, weights, "max")
        ).ratio

    full = next(n for n in range(len(guided)) if ratio(guided[:n], 1) == 1)
    assert full <= 170 and ratio(drawn[:full], 1) < 0.9  # 11 x 12 rows are needed.
    assert ratio(guided, 2) > ratio(drawn, 2)
    assert len(np.unique(guided[:, 0])) == len(guided)  # Values are drawn inside their categories.


@pytest.mark.parametrize("strategy", [PairwiseSampler, CoverageSampler])
def test_a_full_plan_covers_every_feasible_pair(strategy: type[BatchSampler]) -> None:
    points, _ = run(strategy(CONSTRAINED, 0, batch_size=40), 6)
    assert pair_coverage(CONSTRAINED, points) == 1
    assert pair_coverage(SMALL, points) < 1


def test_coverage_returns_more_often_to_heavy_categories() -> None:
    heavy = Space(
        (
            Variable("a", "categorical", values=("x", "y"), weights=(1, 3)),
            Variable("b", "categorical", values=("x", "y")),
        )
    )
    points, _ = run(CoverageSampler(heavy, 0, batch_size=8), 1)
    assert [int(np.sum(points[:, 0] == category)) for category in (0, 1)] == [2, 6]
    nothing = Space(
        tuple(Variable(name, "categorical", values=("x", "y"), weights=(0, 0)) for name in "ab")
    )
    with pytest.raises(
        ValueError, match="coverage is undefined: the weights of all feasible cells sum to 0"
    ):
        CoverageSampler(nothing, 0)


@EVERY
def test_wrong_arguments_are_named(make: Strategy) -> None:
    with pytest.raises(ValueError, match=r"batch_size must be in \[1, 1000\], got 0"):
        make(SMALL, 0, batch_size=0)
    with pytest.raises(ValueError, match=r"seed must be in \[0, inf\), got -1"):
        make(SMALL, -1)
    with pytest.raises(ValueError, match=r"points must have shape \(2, 4\), got \(1, 4\)"):
        make(SMALL, 0).tell(np.zeros((1, 4)), np.zeros(2))


@pytest.mark.parametrize(
    "name", sorted(strategies().keys() - {"forest"})
)  # Its refinements magnify the last bit.
def test_a_kpi_at_the_threshold_is_a_failure_like_one_just_below_it(name: str) -> None:
    """A false activation is told as a KPI at the threshold itself, see `pipeline.core.kpi.told`."""
    make, asked = strategies()[name], []
    for at in (0.1, np.nextafter(0.1, 0)):
        sampler = make(SMALL, 3, batch_size=20)
        for _ in range(3):
            points = sampler.ask()
            sampler.tell(points, np.where(points[:, 0] > 6, at, 1.0))
        asked.append(sampler.ask())
    assert asked[0] == pytest.approx(asked[1])


def test_a_forest_values_a_pair_by_the_square_of_its_failures() -> None:
    assert ForestSampler._gain(np.array([[0, 1], [1, 1]]), np.array([0.0, 1.0])) == pytest.approx(
        [(1 + 0.25) / 2, 0.25]
    )


def test_a_forest_picks_another_kind_of_failure_before_the_same_kind_again() -> None:
    sampler = ForestSampler(
        SMALL, 0, batch_size=2, candidates=3, kinds=0, explore=0, exploitation=0, trees=1, votes=1
    )
    candidates = np.array([[1.2, 40, 1, 0], [1.3, 42, 1, 0], [7.0, 200, 4, 2]])
    chosen = sampler._pick(
        candidates,
        np.array([[0.9, 0.9, 0.5]]),
        candidates[:0],
        np.zeros(0, bool),
        np.random.default_rng(0),
    )
    assert chosen.tolist() == [0, 2]


def test_a_forest_mutates_the_failures_once_there_are_enough() -> None:
    line = Space(tuple(Variable(name, "continuous", "m", 0, 10, 1) for name in "abcde"))
    tested, kpi = line.sample(20, np.random.default_rng(1)), np.where(np.arange(20) < 6, 0.1, 1.0)
    children = ForestSampler(line, 0, mutants=1.0, candidates=50)._candidate_set(
        tested, kpi, np.random.default_rng(0)
    )
    assert (
        len(children) == 50
        and (children[:, None] == tested[None, :6]).any(axis=2).any(axis=1).all()
    )


def test_a_forest_tells_earlier_campaigns_apart() -> None:
    points = SMALL.sample(5, np.random.default_rng(7))
    taught = ForestSampler(SMALL, 0, earlier=[(points, kpi_of(points)), (points, kpi_of(points))])
    assert [taught._inputs(points, campaign)[0, -3:].tolist() for campaign in range(3)] == np.eye(
        3
    ).tolist()


def test_a_mixture_searches_with_the_settings_of_the_published_versions_and_all_that_it_knows() -> (
    None
):
    points = SMALL.sample(20, np.random.default_rng(7))
    campaigns = [(points, kpi_of(points))]
    mixed = strategies()["mixed"](SMALL, 5, failure_threshold_s=0.3, earlier=campaigns)
    assert isinstance(mixed, MixedSampler)
    guide = mixed._guide
    assert (guide.seed, guide.batch_size, guide.failure_threshold_s, len(guide.earlier)) == (
        5,
        10,
        0.3,
        1,
    )
    assert (guide.candidates, guide.mutants, guide.refinements, guide.trees) == (3000, 0.75, 0, 60)
    assert (guide.kinds, guide.explore, guide.explore_until, guide.exploitation, guide.diverse) == (
        0.1,
        0.1,
        1,
        0,
        True,
    )
