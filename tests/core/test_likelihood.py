"""Failure rates: limits against closed forms, estimators against known rates, and their state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.core.exposure import Exposure
from pipeline.core.likelihood.estimator import Estimator
from pipeline.core.likelihood.importance import DEFENSIVE, FEW, ImportanceSampling
from pipeline.core.likelihood.monte_carlo import MonteCarlo
from pipeline.core.likelihood.rate import (
    Limits,
    Rate,
    anytime,
    bounded,
    combined,
    exact,
    one_in,
    sentence,
    spread,
)
from pipeline.core.likelihood.reweighted import reweighted
from pipeline.core.likelihood.subset import FLAT, SHORT, SubsetSimulation, family_limits, moved
from pipeline.core.space import Floats, Space, Variable
from tests.spaces import CONSTRAINED, SMALL

Kpi = Callable[[Floats], Floats]
MADE = {"monte_carlo": MonteCarlo, "subset": SubsetSimulation, "importance": ImportanceSampling}
FAST = {"monte_carlo": {}, "subset": {}, "importance": {"pool": 1000, "trees": 5, "batch_size": 50}}
EXPOSURE = {"variables": {"x": {"kind": "histogram", "edges": [0, 1, 10], "shares": [0.2, 0.8]}}}


def low_x(share: float) -> Kpi:
    """Fails for that share of the exposure, up to 0.2; the KPI is x above the limit."""
    return lambda points: points[:, 0] - 5 * share


def estimator_of(
    name: str, seed: int = 0, budget: int = 1000, space: object = SMALL, **more: object
) -> Estimator:
    method: Callable[..., Estimator] = MADE[name]
    return method(
        space=space,
        seed=seed,
        exposure=EXPOSURE,
        budget=budget,
        failure_threshold_s=0.0,
        **{**FAST[name], **more},
    )


def run(estimator: Estimator, kpi: Kpi, stop_after: int | None = None) -> Floats:
    """Ask and tell; returns the points."""
    batches: list[Floats] = []
    while (
        len(points := estimator.ask()[: estimator.budget - sum(map(len, batches))])
        and len(batches) != stop_after
    ):
        estimator.tell(points, kpi(points))
        batches.append(points)
    return np.concatenate(batches)


def test_exact_limits_of_known_counts() -> None:
    assert exact(0, 2995).below == pytest.approx(1 - 0.05 ** (1 / 2995))
    assert exact(0, 2995).below <= 0.001 < exact(0, 2994).below
    assert (exact(3, 50).low, exact(3, 50).high) == pytest.approx((0.012549, 0.165482), abs=1e-6)
    assert exact(0, 0) == Limits(0, 1, 1) and exact(5, 5).high == 1


def test_anytime_limits_contain_the_exact_ones() -> None:
    for failures, tests in ((0, 100), (1, 100), (20, 1000), (100, 100)):
        wide, narrow = anytime(failures, tests), exact(failures, tests)
        assert (
            wide.low <= narrow.low
            and narrow.high <= wide.high
            and narrow.below <= wide.below <= wide.high
        )


def test_anytime_limits_hold_at_all_moments_at_once() -> None:
    rng, rate, wrong = np.random.default_rng(0), 0.05, 0
    for _ in range(200):
        counts = np.cumsum(rng.random(1000) < rate)
        looks = [anytime(int(counts[n - 1]), n) for n in range(50, 1001, 50)]
        wrong += any(not limits.low <= rate <= limits.high for limits in looks)
    assert wrong <= 200 * 0.05


def test_equal_weights_give_the_poisson_interval() -> None:
    limits = bounded(np.ones(4), 1.0, 100)
    assert (limits.low, limits.high) == pytest.approx(
        (0.010899, 0.102416), abs=1e-6
    )  # Garwood's for 4 events.
    for never in (
        np.zeros(0),
        np.zeros(3),
    ):  # Failures that the road does not show count like none.
        assert bounded(never, 5.0, 1000).below == pytest.approx(5 * -np.log(0.05) / 1000)


def test_a_wide_estimate_never_leaves_the_unit_interval() -> None:
    assert spread(0.3, 1.0).high == 1 and spread(0.3, 1.0).low > 0


def test_the_system_rate_weighs_the_scenarios() -> None:
    rates = [Rate(0.1, Limits(0.05, 0.2, 0.15), 100, 10), Rate(0.0, Limits(0, 0.03, 0.02), 100, 0)]
    system = combined(rates, [0.25, 0.75])
    assert system.value == pytest.approx(0.025) and system.tests == 200 and system.failures == 10
    assert system.limits.high == pytest.approx(0.025 + np.hypot(0.25 * 0.1, 0.75 * 0.03))
    assert system.limits.low == pytest.approx(0.025 - 0.25 * 0.05)
    with pytest.raises(
        ValueError, match="a share for each of 2 scenarios, together 1, got \\[0.5, 0.4\\]"
    ):
        combined(rates, [0.5, 0.4])
    # These shares sum to a little more than 1.
    every = combined(
        [Rate(1.0, exact(5, 5), 5, 5)] * 3, [share / 0.3 for share in (0.05, 0.2, 0.05)]
    )
    assert (every.value, every.limits.high) == (1, 1)
    assert system.limits.below == pytest.approx(0.025 + np.hypot(0.25 * 0.05, 0.75 * 0.02))


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (0.001, "1 in 1,000"),
        (0.00101, "1 in 990"),
        (1 / 1555, "1 in 1,500"),
        (0.034, "1 in 29"),
        (0.1004, "10.1 %"),
        (1.0, "100 %"),
    ],
)
def test_a_claim_is_never_rounded_to_the_better_side(share: float, words: str) -> None:
    assert one_in(share) == words


def test_the_sentence_names_exposure_and_tests() -> None:
    rate = Rate(0.0, exact(0, 2995), 2995, 0)
    assert (
        sentence(rate, "town")
        == "95 % sure: below 1 in 1,000 under exposure 'town', after 2,995 tests"
    )


@pytest.mark.parametrize("name", MADE)
def test_an_interval_holds_about_as_often_as_it_says(name: str) -> None:
    true = {"monte_carlo": 0.05, "subset": 0.002, "importance": 0.08}[name]
    inside, values = 0, []
    for seed in range(40):
        estimator = estimator_of(name, seed)
        run(estimator, low_x(true))
        rate = estimator.rate()
        inside += rate.limits.low <= true <= rate.limits.high
        values.append(rate.value)
    assert inside >= 35  # Fewer have a probability below 2 % at 95 % coverage.
    assert np.mean(values) == pytest.approx(true, rel=0.15)


@pytest.mark.parametrize("name", MADE)
def test_telling_the_same_batches_again_restores_an_estimator(name: str) -> None:
    first, second = estimator_of(name), estimator_of(name)
    run(first, low_x(0.1), stop_after=12)
    run(second, low_x(0.1), stop_after=8)
    run(second, low_x(0.1), stop_after=4)
    np.testing.assert_array_equal(first.ask(), second.ask())
    np.testing.assert_array_equal(first.ask(), second.ask())
    assert first.rate() == second.rate()


@pytest.mark.parametrize("name", MADE)
def test_an_estimator_that_is_only_told_knows_as_much(name: str) -> None:
    asking, copy = estimator_of(name), estimator_of(name)
    for _ in range(12):
        points = asking.ask()
        for estimator in (asking, copy):
            estimator.tell(points, low_x(0.1)(points))
    assert asking.rate() == copy.rate()
    np.testing.assert_array_equal(asking.ask(), copy.ask())


@pytest.mark.parametrize("name", MADE)
def test_points_keep_the_constraints(name: str) -> None:
    points = run(estimator_of(name, space=CONSTRAINED), low_x(0.1))
    assert len(points) > 100 and CONSTRAINED.violation(points) is None


@pytest.mark.parametrize("name", MADE)
def test_errors_are_in_no_count_of_tests(name: str) -> None:
    estimator = estimator_of(name)
    run(estimator, lambda points: np.where(points[:, 0] > 9, np.nan, low_x(0.1)(points)))
    rate = estimator.rate()
    assert rate.errors > 0 and rate.tests + rate.errors <= 1000


def test_a_settled_question_ends_the_tests() -> None:
    below = estimator_of("monte_carlo", below=0.05)
    run(below, lambda points: np.ones(len(points)))
    assert below.rate().tests < 200 and below.rate().limits.below < 0.05
    above = estimator_of("monte_carlo", below=0.05)
    run(above, low_x(0.2))
    assert above.rate().tests < 300 and above.rate().limits.low > 0.05


def test_moves_keep_the_exposure() -> None:
    exposure, rng = Exposure.from_dict(SMALL, EXPOSURE), np.random.default_rng(0)
    latent = rng.random((20_000, exposure.latent_size))
    for _ in range(5):
        latent = moved(exposure, latent, 0.6, rng)
    assert latent.min() >= 0 and latent.max() < 1
    assert latent.mean(axis=0) == pytest.approx(0.5, abs=0.01)
    assert np.quantile(latent, 0.01, axis=0) == pytest.approx(0.01, abs=0.003)


def test_families_spread_the_estimate_and_two_more_may_be_unseen() -> None:
    limits = family_limits(0.01, np.array([3, 3, 7, 7]))
    error = np.sqrt(0.5)  # Of two equal families.
    assert limits.low == pytest.approx(0.01 * np.exp(-1.959964 * error))
    assert limits.high == pytest.approx(0.01 * np.exp(1.959964 * error) * (1 + 2 * 0.5))
    assert limits.below == pytest.approx(0.01 * np.exp(1.644854 * error) * 2)
    assert family_limits(0.4, np.zeros(5, int)).high == 1


def test_subset_simulation_says_when_the_kpi_leads_nowhere() -> None:
    estimator = estimator_of("subset")
    run(estimator, lambda points: np.ones(len(points)))
    rate = estimator.rate()
    assert (
        rate.note == FLAT
        and rate.value == 0
        and rate.limits.below == pytest.approx(exact(0, 220).below)
    )


def test_subset_simulation_on_pass_or_fail_alone_counts_like_monte_carlo() -> None:
    estimator = estimator_of("subset")
    run(estimator, lambda points: np.where(points[:, 0] < 0.25, 0.0, 1.0))
    rate = estimator.rate()
    assert rate.limits.low <= 0.05 <= rate.limits.high and not rate.note


def test_a_budget_that_ends_above_the_failures_gives_an_upper_limit() -> None:
    estimator = estimator_of("subset", budget=300)
    run(estimator, low_x(1e-9))
    rate = estimator.rate()
    assert (
        rate.note == SHORT
        and (rate.value, rate.limits.low) == (0, 0)
        and 1e-9 < rate.limits.below < 0.05
    )


def test_importance_sampling_without_failures_stays_random() -> None:
    estimator = estimator_of("importance")
    run(estimator, lambda points: np.ones(len(points)))
    assert estimator.rate().note == FEW and estimator.rate().limits == exact(0, 1000)


def test_weights_are_bounded_by_the_defensive_share() -> None:
    estimator = estimator_of("importance")
    assert isinstance(estimator, ImportanceSampling)
    run(estimator, low_x(0.1))
    chosen = estimator._weights[estimator._random :]
    assert len(chosen) and chosen.max() <= 1 / DEFENSIVE + 1e-9 and chosen.min() < 0.5


def test_uniform_tests_are_reweighted_to_the_exposure() -> None:
    exposure = Exposure.from_dict(SMALL, EXPOSURE)
    points = SMALL.sample(20_000, np.random.default_rng(0))
    rate = reweighted(exposure, points, points[:, 0] < 0.5)
    assert rate.value == pytest.approx(0.1, rel=0.1) and rate.limits.low < 0.1 < rate.limits.high
    assert "20,000 uniform tests are worth" in rate.note
    with pytest.raises(ValueError, match="at least one test"):
        reweighted(exposure, points[:0], np.zeros(0, bool))


def test_the_rate_holds_where_constraints_leave_little() -> None:
    """With 30 values each of `a` and `b`, 0.2 % of all combinations are feasible."""
    names = [f"v{i}" for i in range(30)]
    a, b, c = (
        Variable(name, "categorical", values=tuple(values))
        for name, values in (("a", names), ("b", names), ("c", "xy"))
    )
    space = Space((a, b, c), (("a = v0", "a = v1"), ("b = v0",)))
    points = space.sample(20_000, np.random.default_rng(1))
    often = {"v0": 0.5, **dict.fromkeys(names[1:], 0.5 / 29)}
    exposure = {
        "a": {"kind": "shares", "shares": often},
        "c": {"kind": "shares", "shares": {"x": 0.9, "y": 0.1}},
    }
    rate = reweighted(Exposure.from_dict(space, {"variables": exposure}), points, points[:, 2] == 0)
    assert rate.limits.low <= 0.9 <= rate.limits.high and rate.value == pytest.approx(0.9, abs=0.02)


def test_errors_where_the_road_seldom_is_leave_the_rate_of_the_other_conditions() -> None:
    points = SMALL.sample(20_000, np.random.default_rng(0))
    valid = points[points[:, 0] < 1]  # A tenth of the tests, but a fifth of the exposure.
    rate = reweighted(
        Exposure.from_dict(SMALL, EXPOSURE), valid, valid[:, 0] < 0.5, 20_000 - len(valid)
    )
    assert rate.value == pytest.approx(0.5, rel=0.1) and rate.limits.low < 0.5 < rate.limits.high
    elsewhere = {"variables": {"x": {"kind": "histogram", "edges": [5, 10], "shares": [1]}}}
    assert reweighted(
        Exposure.from_dict(SMALL, elsewhere), valid, valid[:, 0] < 0.5, 1
    ).limits == Limits(0, 1, 1)


def test_errors_that_the_search_avoids_leave_the_rate_of_the_other_conditions() -> None:
    fails, rates = low_x(0.1), []
    for seed in range(5):
        estimator = estimator_of("importance", seed)
        run(estimator, lambda points: np.where(points[:, 0] > 5, np.nan, fails(points)))
        assert estimator.rate().note != FEW
        rates.append(estimator.rate().value)
    assert np.mean(rates) == pytest.approx(0.1 / (1 - 0.8 * 5 / 9), rel=0.1)


@pytest.mark.parametrize("name", MADE)
def test_errors_alone_allow_no_claim(name: str) -> None:
    estimator = estimator_of(name)
    run(estimator, lambda points: np.full(len(points), np.nan))
    assert estimator.rate().limits.below == 1


def test_wrong_settings_are_told() -> None:
    for settings, message in (
        ({"budget": 99}, "budget must be at least 100 tests, got 99"),
        ({"below": 1.0}, "below must be in (0, 1), got 1.0"),
    ):
        with pytest.raises(ValueError) as error:  # noqa: PT011
            estimator_of("monte_carlo", **settings)  # type: ignore[arg-type]
        assert message in str(error.value)


def test_an_estimate_that_rests_on_five_failures_has_four_degrees_of_freedom() -> None:
    limits = spread(0.01, 5.0)
    assert (limits.low, limits.high) == pytest.approx(
        (0.01 * np.exp(-2.77645 / 5**0.5), 0.01 * np.exp(2.77645 / 5**0.5)), rel=1e-5
    )
    assert limits.below == pytest.approx(0.01 * np.exp(2.13185 / 5**0.5), rel=1e-5)


def test_failures_that_come_after_half_of_the_budget_leave_all_tests_random() -> None:
    estimator = estimator_of("importance", budget=200, batch_size=20)
    run(
        estimator, lambda points: np.where(np.arange(len(points)) % 8 == 0, -1.0, 1.0)
    )  # Three of 20: 20 after 140 tests.
    assert estimator.rate().note == FEW and estimator.rate().limits == exact(30, 200)


def test_a_weight_that_no_test_shows_leaves_the_limit_open() -> None:
    """Nine in ten conditions on the road lie in a thousandth of the space, without any test."""
    rare = {"variables": {"x": {"kind": "histogram", "edges": [0, 9.99, 10], "shares": [0.1, 0.9]}}}
    points = SMALL.sample(200, np.random.default_rng(0)) * [0.99, 1, 1, 1]
    assert (
        reweighted(Exposure.from_dict(SMALL, rare), points, np.zeros(200, bool)).limits.below == 1
    )


@pytest.mark.parametrize("name", MADE)
def test_a_kpi_at_the_threshold_is_a_failure(name: str) -> None:
    estimator = estimator_of(name)
    run(estimator, lambda points: np.zeros(len(points)))
    assert estimator.rate().failures == estimator.rate().tests > 0
