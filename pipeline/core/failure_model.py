"""Models of the probability that a test fails, learnt from tests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipeline.core.samplers.meta_model import scaled
from pipeline.core.space import Floats

Chances = Callable[[Floats], Floats]
"""From the inputs (m, f) of other tests to their failure probability."""

TREE_FEATURES = 0.7
"""Share of the inputs that a tree tries at each of its nodes."""
LINEAR_TRUST = 0.75
"""What the linear model's probability counts where the trees expect no failure."""
EDGE = 1e-9


def tree_chances(
    inputs: Floats, failed: NDArray[np.bool_], trees: int, rng: np.random.Generator
) -> Chances:
    """Extremely randomised trees that have learnt which tests failed (Geurts et al., 2006): the failure probability by each, (trees, m).

    inputs: (n, f). failed: (n,) whether those tests failed.
    """
    from sklearn import (
        config_context,
    )  # Takes seconds, and every study makes every strategy to check it.
    from sklearn.tree import ExtraTreeRegressor

    # The trees of scikit-learn's ExtraTreesRegressor, bit for bit, without the copies and checks that it makes of each.
    seeds = np.random.RandomState(int(rng.integers(2**31))).randint(2**31 - 1, size=trees)
    known, values = inputs.astype(np.float32), failed.astype(float)
    with config_context(skip_parameter_validation=True):
        grown = [
            ExtraTreeRegressor(max_features=TREE_FEATURES, random_state=s).fit(
                known, values, check_input=False
            )
            for s in seeds.tolist()
        ]

    def chances(others: Floats) -> Floats:
        rows = others.astype(np.float32)
        return np.stack([tree.tree_.predict(rows)[:, 0] for tree in grown])

    return chances


def linear_chances(inputs: Floats, kpi: Floats, threshold: float) -> Chances:
    """A Bayesian linear model of the KPI with normal scatter (Tipping, 2001): the probability (m,) of a KPI at or below the threshold."""
    from scipy.special import ndtr
    from sklearn.linear_model import BayesianRidge

    *observed, limit = scaled(np.append(kpi, threshold))
    model = BayesianRidge().fit(inputs, observed)

    def chances(others: Floats) -> Floats:
        mean, deviation = model.predict(others, return_std=True)
        return np.asarray(ndtr((limit - mean) / np.maximum(deviation, EDGE)))

    return chances


def joined(trees: Floats, linear: Floats) -> Floats:
    """Both models' probabilities as a noisy-or: what the trees know to fail cannot gain from the linear model."""
    return np.asarray(trees + (1 - trees) * LINEAR_TRUST * linear)
