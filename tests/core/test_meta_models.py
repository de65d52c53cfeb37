"""The thesis' meta-models and the search with them, by hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import check_grad

from pipeline.core.samplers.gaussian_process import GaussianProcessSampler
from pipeline.core.samplers.linear import LinearSampler
from pipeline.core.samplers.meta_model import Hyperparameters, MetaModel, MetaModelSampler, scaled
from pipeline.core.samplers.network import NetworkSampler, _packed, _unpacked, loss_and_gradients
from pipeline.core.space import Floats, Space, Variable
from tests.spaces import SMALL

inf = np.inf
LINE = Space((Variable("x", "continuous", "m", 0, 10, 1),))


class Constant(MetaModelSampler):
    """Predicts the same KPI everywhere."""

    grid = ({"value": 0.0}, {"value": 0.5}, {"value": 1.0})

    def fit(
        self, inputs: Floats, kpi: Floats, hyperparameters: Hyperparameters, seed: int
    ) -> MetaModel:
        return lambda others: (
            np.full(len(others), hyperparameters["value"]),
            np.zeros(len(others)),
        )


def test_the_grid_is_judged_by_the_squared_error() -> None:
    inputs, kpi = np.zeros((16, 1)), np.full(16, 0.6)
    assert Constant(LINE, 0).tune(inputs, kpi, 0) == {"value": 0.5}
    assert Constant(LINE, 0).tune(inputs, kpi + 0.3, 0) == {"value": 1.0}
    assert Constant(LINE, 0).tune(inputs[:7], kpi[:7] + 0.3, 0) == {
        "value": 0.0
    }  # Too few to split.


@pytest.mark.parametrize(
    ("kpi", "expected"),
    [
        ([2, 4, 3], [0, 1, 0.5]),
        ([-3, -1, -2], [0, 1, 0.5]),
        ([7, 7], [0.5, 0.5]),
        ([inf, inf], [1, 1]),
        ([-inf, 2, inf], [0, 0.5, 1]),
        ([0, 1, 1, 1, 2, inf], [0, 0.5, 0.5, 0.5, 1, 1]),
        ([0, 1, 1, 1, 1, 1e12], [0, 0.25, 0.25, 0.25, 0.25, 1]),
    ],
)
def test_kpis_are_scaled_to_0_and_1(kpi: list[float], expected: list[float]) -> None:
    assert scaled(np.array(kpi, dtype=float)) == pytest.approx(expected)


def test_linear_regression_recovers_the_coefficients() -> None:
    rng = np.random.default_rng(0)
    numbers, kind = rng.normal(size=(40, 2)), rng.integers(3, size=40)
    inputs = np.column_stack([numbers, np.eye(3)[kind]])  # Collinear with the intercept.
    kpi = 0.3 + numbers @ [0.2, -0.1] + np.array([0.0, 0.1, -0.2])[kind]
    model = LinearSampler(SMALL, 0).fit(inputs, kpi, {}, 0)
    assert model(inputs)[0] == pytest.approx(kpi)
    base = model(np.array([[0, 0, 1, 0, 0]]))[0]
    assert model(np.array([[1, 0, 1, 0, 0], [0, 1, 1, 0, 0], [0, 0, 0, 0, 1]]))[
        0
    ] - base == pytest.approx([0.2, -0.1, -0.2])


def test_a_gaussian_process_passes_through_its_data_and_is_sure_there() -> None:
    inputs, kpi = np.array([[-2.0], [0.0], [1.5]]), np.array([0.2, 0.9, 0.4])
    model = GaussianProcessSampler(LINE, 0).fit(inputs, kpi, {"length": 1.0, "noise": 1e-10}, 0)
    mean, deviation = model(np.array([[-2.0], [0.0], [1.5], [50.0]]))
    assert mean == pytest.approx(
        [0.2, 0.9, 0.4, 0.5], abs=1e-4
    )  # Far away, the prior: mean and deviation of the data.
    assert deviation == pytest.approx([0, 0, 0, kpi.std()], abs=1e-4)


def test_a_gaussian_process_has_the_posterior_of_the_appendix() -> None:
    """Eq. .11 to .15: standardised KPIs -1 and 1 at 0 and 2, sigma 1, noise 0.5; at 1, between."""
    model = GaussianProcessSampler(LINE, 0).fit(
        np.array([[0.0], [2.0]]), np.array([0.0, 2.0]), {"length": 1.0, "noise": 0.5}, 0
    )
    near, far = np.exp(-0.5), np.exp(-2)
    mean, deviation = model(np.array([[1.0], [0.0]]))
    assert mean == pytest.approx([1, 1 - (1 - far) / (1.5 - far)])
    assert deviation[0] ** 2 == pytest.approx(1 - 2 * near**2 / (1.5 + far))


def test_kappa_prefers_uncertain_candidates() -> None:
    assert list(
        GaussianProcessSampler(LINE, 0, kappa=2.0).rank(np.array([0.5, 0.4]), np.array([0.2, 0.1]))
    ) == pytest.approx([0.1, 0.2])
    with pytest.raises(ValueError, match=r"kappa must be in \[0, 100\], got -1"):
        GaussianProcessSampler(LINE, 0, kappa=-1)


def test_a_network_descends_along_its_gradient() -> None:
    rng, shapes = np.random.default_rng(0), [(3, 4), (4, 2), (2, 1)]
    inputs, kpi = rng.normal(size=(7, 3)), rng.random(7)
    start = _packed([(rng.normal(size=shape), rng.normal(size=shape[1])) for shape in shapes])
    assert (
        check_grad(
            lambda flat: loss_and_gradients(_unpacked(flat, shapes), inputs, kpi, 0.1)[0],
            lambda flat: _packed(loss_and_gradients(_unpacked(flat, shapes), inputs, kpi, 0.1)[1]),
            start,
        )
        < 1e-6
    )


def test_a_network_learns_an_interaction_and_stays_between_0_and_1() -> None:
    inputs = np.random.default_rng(0).uniform(-1.7, 1.7, size=(200, 2))
    kpi = (inputs.prod(axis=1) > 0).astype(float)
    model = NetworkSampler(SMALL, 0).fit(inputs, kpi, {"hidden": (16,), "penalty": 1e-3}, 0)
    assert np.mean((model(inputs)[0] > 0.5) == (kpi > 0.5)) > 0.95
    far = model(100 * inputs)[0]
    assert (far >= 0).all() and (far <= 1).all()


def batch(kpi: Callable[[Floats], Floats], **settings: float) -> tuple[Floats, Floats]:
    """The first and the second batch of a linear search on a line."""
    sampler = LinearSampler(LINE, 0, batch_size=10, **settings)  # type: ignore[arg-type]
    first = sampler.ask()
    sampler.tell(first, kpi(first[:, 0]))
    return first[:, 0], sampler.ask()[:, 0]


def test_the_lowest_predictions_are_tested_and_others_at_random() -> None:
    _, second = batch(lambda x: 2 - x / 10, explore=0.3)
    assert (second[:7] > 9.8).all() and (second[7:] < 9.8).any()


def test_established_failure_regions_are_left() -> None:
    first, second = batch(
        lambda x: np.where(x > 5, 0.0, 1.0), explore=0.0, epsilon=0.3, omega_threshold=-1
    )
    near = np.abs(second[:, None] - first) < 3
    assert (near @ np.where(first > 5, -1, 1) > -1).all()


def test_random_tests_fill_a_batch_without_relevant_candidates() -> None:
    first, second = batch(lambda x: 0 * x, epsilon=2.0)
    assert len(second) == 10 and np.ptp(second) > 3 and set(first).isdisjoint(second)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"candidates": 5}, "candidates must be at least batch_size, 20, got 5"),
        ({"explore": 1.5}, r"explore must be in \[0, 1\], got 1.5"),
        ({"epsilon": 0.0}, r"epsilon must be in \(0, 10\], got 0.0"),
        ({"omega_threshold": 0}, r"omega_threshold must be in \[-100000, 0\), got 0"),
        ({"tune_every": 0}, r"tune_every must be in \[1, 1000\], got 0"),
    ],
)
def test_wrong_settings_are_named(settings: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        LinearSampler(SMALL, 0, **settings)  # type: ignore[arg-type]


def test_hyperparameters_are_chosen_after_the_first_batch_and_kept_for_some() -> None:
    sampler, points = Constant(LINE, 0, batch_size=8, tune_every=5), np.zeros((48, 1))
    kpi = np.where(
        np.arange(48) < 8, 1.0, 0.0
    )  # Equal KPIs count as a half; later, most are the lowest.
    assert [sampler._hyperparameters(index, points, kpi)["value"] for index in (1, 5, 6)] == [
        0.5,
        0.5,
        0.0,
    ]
