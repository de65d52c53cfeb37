"""Variants of the default strategy in which one part is another, to see what each part is worth. They serve development alone.

Settings alone make others, such as `forest kinds=0`; see the module of the forest.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import recorded
from scipy.special import ndtr
from sklearn.ensemble import GradientBoostingRegressor
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.linear_model import BayesianRidge
from sklearn.neural_network import MLPRegressor

from pipeline.core.failure_model import Chances, joined, tree_chances
from pipeline.core.samplers.features import features
from pipeline.core.samplers.forest import ForestSampler
from pipeline.core.samplers.meta_model import scaled
from pipeline.core.space import Floats


@dataclass(eq=False, repr=False, kw_only=True)
class TreesAlone(ForestSampler):
    """Without the linear model: while nothing has failed, all candidates are alike."""

    def _linear(self, inputs: Floats, kpi: Floats) -> Chances:
        return lambda others: np.zeros(len(others))


@dataclass(eq=False, repr=False, kw_only=True)
class LinearAlone(ForestSampler):
    """Without the trees."""

    def _learn(self, inputs: Floats, kpi: Floats, rng: np.random.Generator) -> Chances:
        return _one_vote(self.trees, self._linear(inputs, kpi))


@dataclass(eq=False, repr=False, kw_only=True)
class Mean(ForestSampler):
    """The mean of the two models' probabilities instead of a noisy-or."""

    def _learn(self, inputs: Floats, kpi: Floats, rng: np.random.Generator) -> Chances:
        trees = tree_chances(inputs, kpi <= self.failure_threshold_s, self.trees, rng)
        linear = self._linear(inputs, kpi)
        return lambda others: (trees(others) + linear(others)) / 2


@dataclass(eq=False, repr=False, kw_only=True)
class Boosting(ForestSampler):
    """Boosted trees instead of the forest; they give one vote."""

    def _learn(self, inputs: Floats, kpi: Floats, rng: np.random.Generator) -> Chances:
        settings = {
            "n_estimators": 60,
            "subsample": 0.7,
            "max_features": 0.4,
            "random_state": int(rng.integers(2**31)),
        }
        boosted = GradientBoostingRegressor(**settings).fit(inputs, kpi <= self.failure_threshold_s)
        linear = self._linear(inputs, kpi)
        return _one_vote(
            self.trees,
            lambda others: joined(np.clip(boosted.predict(others), 0, 1), linear(others)),
        )


@dataclass(eq=False, repr=False, kw_only=True)
class LevelSet(ForestSampler):
    """A Gaussian process of the KPI alone: P(KPI at or below the threshold), the level set that is sought (Gotovos et al., 2013)."""

    def _learn(self, inputs: Floats, kpi: Floats, rng: np.random.Generator) -> Chances:
        *observed, threshold = scaled(np.append(kpi, self.failure_threshold_s))
        kernel = ConstantKernel(0.2) * RBF(3.0) + WhiteKernel(0.1)
        process = GaussianProcessRegressor(kernel, optimizer=None, normalize_y=True).fit(
            inputs, observed
        )
        return _one_vote(self.trees, _below(threshold, process))


@dataclass(eq=False, repr=False, kw_only=True)
class DeepKernel(ForestSampler):
    """A network of the KPI whose last layer is a Bayesian linear model, instead of the plain linear model (Snoek et al., 2015)."""

    def _linear(self, inputs: Floats, kpi: Floats) -> Chances:
        *observed, threshold = scaled(np.append(kpi, self.failure_threshold_s))
        settings = {
            "hidden_layer_sizes": (32,),
            "activation": "tanh",
            "solver": "lbfgs",
            "alpha": 1.0,
            "max_iter": 60,
            "random_state": 0,
        }
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", ConvergenceWarning
            )  # Stopping early is part of the regularisation.
            network = MLPRegressor(**settings).fit(inputs, observed)

        def hidden(rows: Floats) -> Floats:
            return np.asarray(np.tanh(rows @ network.coefs_[0] + network.intercepts_[0]))

        below = _below(threshold, BayesianRidge().fit(hidden(inputs), observed))
        return lambda others: below(hidden(others))


@dataclass(eq=False, repr=False, kw_only=True)
class NoAttributes(ForestSampler):
    """Without the attributes of categories, such as a pedestrian's height."""

    def _inputs(self, points: Floats, campaign: int) -> Floats:
        return features(self.space, points, attributes=False)


@dataclass(eq=False, repr=False, kw_only=True)
class Transfer(ForestSampler):
    """Learns from 300 recorded tests of F2, too, as a study with `campaign.transfer` would; for worlds of F3."""

    def __post_init__(self) -> None:
        super().__post_init__()
        table, points = recorded.campaign(
            recorded.path_of("F2", "forest", recorded.DENSE), self.space
        )
        self.earlier = [(points[:300], table["adj_ttc_s"].to_numpy(float)[:300])]


VARIANTS: dict[str, type[ForestSampler]] = {
    "forest-trees-alone": TreesAlone,
    "forest-linear-alone": LinearAlone,
    "forest-mean": Mean,
    "forest-boosting": Boosting,
    "forest-level-set": LevelSet,
    "forest-deep-kernel": DeepKernel,
    "forest-no-attributes": NoAttributes,
    "forest-transfer": Transfer,
}


def expected(model: ForestSampler, points: Floats, kpi: Floats, others: Floats) -> Floats:
    """The failure probability of other points (m, d), as (m,), by the models of a search that has seen points (n, d) and their KPI (n,)."""
    inputs, observed = model._lessons(points, kpi)
    votes_of = model._learn(inputs, observed, np.random.default_rng(0))
    return np.asarray(votes_of(model._inputs(others, len(model.earlier))).mean(axis=0))


def _one_vote(trees: int, chances: Chances) -> Chances:
    """A model's chances as the votes of as many trees that agree."""
    return lambda others: np.tile(chances(others), (trees, 1))


def _below(threshold: float, model: BayesianRidge | GaussianProcessRegressor) -> Chances:
    """The probability that what a model predicts, with normal scatter, is at or below the threshold."""

    def chances(others: Floats) -> Floats:
        mean, deviation = model.predict(others, return_std=True)
        return np.asarray(ndtr((threshold - mean) / np.maximum(deviation, 1e-9)))

    return chances
