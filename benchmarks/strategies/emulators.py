"""Emulators: the failure probability and the KPI of a scenario's tests, by models of two families fitted to rendered tests.

Two families, because a strategy whose meta-model has the shape of the judge would be at an advantage.
"""

from __future__ import annotations

import warnings
from typing import Protocol

import numpy as np
from recorded import Recorded
from scipy.special import expit, logit, ndtr, ndtri
from sklearn.ensemble import ExtraTreesClassifier, ExtraTreesRegressor
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPClassifier, MLPRegressor

from pipeline.core.samplers.features import features
from pipeline.core.space import Floats, Space
from pipeline.errors import InputError

FEWEST = 20
"""Failures, and passing tests, that an emulator needs."""
EDGE = 1e-6
WAVES = 200
REACH = 1.5
"""Distance in standardised inputs over which the smooth part of chance changes."""
SMOOTH = 0.5
"""Share of the variance of chance that is smooth: near tests share their fate, as far as the model does not explain it."""
CALIBRATION_POINTS = 40_000


class Model(Protocol):
    """A fitted model. Inputs are (n, f), see `features`."""

    def probability(self, inputs: Floats) -> Floats:
        """(n,) probabilities of failure."""
        ...

    def passing_kpi(self, inputs: Floats) -> Floats:
        """(n,) mean KPIs of tests that do not fail, seconds."""
        ...


class Trees:
    """Extra trees."""

    def __init__(self, inputs: Floats, recorded: Recorded) -> None:
        settings = {"min_samples_leaf": 3, "max_features": 0.4, "random_state": 0}
        failed = recorded.failed
        self._fails = ExtraTreesClassifier(200, **settings).fit(inputs, failed).estimators_
        self._passes = (
            ExtraTreesRegressor(100, **settings)
            .fit(inputs[~failed], recorded.kpi[~failed])
            .estimators_
        )

    def probability(self, inputs: Floats) -> Floats:
        rows = inputs.astype(
            np.float32
        )  # A batch is small: scikit-learn's own checks would cost more than the trees.
        return np.asarray(np.mean([tree.tree_.predict(rows)[:, 1] for tree in self._fails], axis=0))

    def passing_kpi(self, inputs: Floats) -> Floats:
        rows = inputs.astype(np.float32)
        return np.asarray(
            np.mean([tree.tree_.predict(rows)[:, 0] for tree in self._passes], axis=0)
        )


class Network:
    """Multi-layer perceptrons, stopped early."""

    def __init__(self, inputs: Floats, recorded: Recorded) -> None:
        settings = {
            "hidden_layer_sizes": (64, 32),
            "alpha": 1e-2,
            "early_stopping": True,
            "n_iter_no_change": 15,
            "random_state": 0,
        }
        failed, passing = recorded.failed, recorded.kpi[~recorded.failed]
        self._mean, self._deviation = float(passing.mean()), max(float(passing.std()), 1e-9)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            self._fails = MLPClassifier(**settings).fit(inputs, failed)
            self._passes = MLPRegressor(**settings).fit(
                inputs[~failed], (passing - self._mean) / self._deviation
            )

    def probability(self, inputs: Floats) -> Floats:
        return np.asarray(self._fails.predict_proba(inputs)[:, 1])

    def passing_kpi(self, inputs: Floats) -> Floats:
        return self._mean + self._deviation * np.asarray(self._passes.predict(inputs))


FAMILIES: dict[str, type[Trees] | type[Network]] = {"trees": Trees, "network": Network}


def fit(family: str, recorded: Recorded) -> Model:
    """A model of a family; InputError for too few failures or passing tests."""
    failures, passing = int(recorded.failed.sum()), int((~recorded.failed).sum())
    if min(failures, passing) < FEWEST:
        raise InputError(
            f"an emulator needs {FEWEST} failures and {FEWEST} other tests, got {failures} and {passing}; record more tests"
        )
    return FAMILIES[family](features(recorded.space, recorded.points), recorded)


class Emulator:
    """A model with its scatter: what all worlds of a scenario and family share."""

    def __init__(self, family: str, recorded: Recorded) -> None:
        self.space, self.model = recorded.space, fit(family, recorded)
        self.highest_s = float(recorded.kpi.max())
        order = np.random.default_rng(0).permutation(len(recorded.kpi))
        cut = len(order) // 4
        # How far a passing test lies from the model, by tests that it has not seen.
        other, unseen = fit(family, recorded.rows(order[cut:])), recorded.rows(order[:cut])
        misses = unseen.kpi - other.passing_kpi(features(unseen.space, unseen.points))
        self.scatter_s = float(misses[~unseen.failed].std())


class EmulatedWorld:
    """A scenario whose tests fail or pass as its emulator says, without rendering.

    A test fails where chance, a uniform field of its point, is below its emulated probability. Half of the field is smooth, half white
    noise, so it is a function of the point alone. A failure has KPI 0; a test that just passes has a low KPI. The seed draws the field.
    share: of random tests that fail; the log-odds of all tests are shifted until this share of a fixed random sample fails. Without it,
    as often as in the recorded tests.
    """

    def __init__(
        self, emulator: Emulator, seed: int, share: float | None, failure_threshold_s: float
    ) -> None:
        self.space, self._emulator, self._seed, self._threshold_s = (
            emulator.space,
            emulator,
            seed,
            failure_threshold_s,
        )
        rng = np.random.default_rng([seed, 7])
        width = features(self.space, self.space.sample(1, rng)).shape[1]
        self._waves, self._phases = (
            rng.normal(0, 1 / REACH, (width, WAVES)),
            rng.uniform(0, 2 * np.pi, WAVES),
        )
        self.shift = 0.0
        if share is not None:
            # A test fails if its shift exceeds its log-odds of chance over those of failing, so the shift sought is a quantile of them.
            sample = self.space.sample(CALIBRATION_POINTS, np.random.default_rng(1))
            self.shift = float(
                np.quantile(
                    np.concatenate([self._margin(part) for part in np.array_split(sample, 20)]),
                    share,
                )
            )

    def kpi(self, points: Floats) -> Floats:
        """(n, d) points to (n,) seconds; 0 for a failure."""
        inputs = features(self.space, points)
        probability = expit(_log_odds(self._emulator.model.probability(inputs)) + self.shift)
        chance = self._chance(points, inputs)
        # The place of a passing test among all that pass here: the lowest have only just passed.
        rank = np.clip((chance - probability) / (1 - probability), EDGE, 1 - EDGE)
        kpi = self._emulator.model.passing_kpi(inputs) + self._emulator.scatter_s * ndtri(rank)
        lowest = np.nextafter(self._threshold_s, np.inf)
        return np.where(chance < probability, 0.0, np.clip(kpi, lowest, self._emulator.highest_s))

    def _margin(self, points: Floats) -> Floats:
        inputs = features(self.space, points)
        return np.asarray(
            logit(self._chance(points, inputs))
            - _log_odds(self._emulator.model.probability(inputs))
        )

    def _chance(self, points: Floats, inputs: Floats) -> Floats:
        """Uniform numbers of the points, (n,) in (0, 1)."""
        smooth = np.cos(inputs @ self._waves + self._phases).sum(axis=1) * np.sqrt(2 / WAVES)
        white = ndtri(np.clip(_hashed(points, self._seed), EDGE, 1 - EDGE))
        return np.asarray(
            np.clip(ndtr(np.sqrt(SMOOTH) * smooth + np.sqrt(1 - SMOOTH) * white), EDGE, 1 - EDGE)
        )


def _log_odds(probability: Floats) -> Floats:
    return np.asarray(logit(np.clip(probability, EDGE, 1 - EDGE)))


def _hashed(points: Floats, seed: int) -> Floats:
    """Numbers in [0, 1) that depend on the bits of (n, d) points and on the seed alone (SplitMix64, Steele et al. 2014)."""
    bits = np.ascontiguousarray(points + 0.0).view(np.uint64)  # -0.0 becomes 0.0.
    state = np.full(len(points), seed + 1, np.uint64)
    for column in bits.T:
        state = (state ^ column) + np.uint64(0x9E3779B97F4A7C15)
        state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        state = state ^ (state >> np.uint64(31))
    return np.asarray((state >> np.uint64(11)) * 2.0**-53)


def expected_kpi(model: Model, space: Space, points: Floats) -> tuple[Floats, Floats]:
    """Probability of failure and expected KPI, (n,) each: what the model predicts of tests without drawing chance."""
    inputs = features(space, points)
    probability = model.probability(inputs)
    return probability, (1 - probability) * model.passing_kpi(inputs)
