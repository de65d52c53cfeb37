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
    """Failure probability by each of several extremely randomised trees (Geurts et al., 2006).

    Args:
        inputs: (n, f) of the tests to learn from.
        failed: (n,) whether those tests failed.
        trees: number of trees.
        rng: source of randomness.

    Returns:
        From the inputs (m, f) of other tests to their failure probability by each tree, (trees, m).
    """
    # Imported late: that takes seconds, and every study makes every strategy to check it.
    from sklearn import config_context
    from sklearn.tree import ExtraTreeRegressor

    # The trees of scikit-learn's ExtraTreesRegressor, bit for bit, without the copies and checks
    # that it makes of each.
    seeds = np.random.RandomState(int(rng.integers(2**31))).randint(2**31 - 1, size=trees)
    rows, values = inputs.astype(np.float32), failed.astype(float)
    grown = []
    with config_context(skip_parameter_validation=True):
        for seed in seeds.tolist():
            tree = ExtraTreeRegressor(max_features=TREE_FEATURES, random_state=seed)
            grown.append(tree.fit(rows, values, check_input=False))

    def chances(others: Floats) -> Floats:
        others = others.astype(np.float32)
        return np.stack([tree.tree_.predict(others)[:, 0] for tree in grown])

    return chances


def linear_chances(inputs: Floats, kpi: Floats, threshold: float) -> Chances:
    """Failure probability by a Bayesian linear model of the KPI (Tipping, 2001).

    Args:
        inputs: (n, f) of the tests to learn from.
        kpi: (n,) of those tests.
        threshold: a test with a KPI at or below it is a failure.

    Returns:
        From the inputs (m, f) of other tests to their failure probability, (m,).
    """
    from scipy.special import ndtr
    from sklearn.linear_model import BayesianRidge

    *observed, limit = scaled(np.append(kpi, threshold))
    model = BayesianRidge().fit(inputs, observed)

    def chances(others: Floats) -> Floats:
        mean, deviation = model.predict(others, return_std=True)
        return np.asarray(ndtr((limit - mean) / np.maximum(deviation, EDGE)))

    return chances


def joined(trees: Floats, linear: Floats) -> Floats:
    """Both models' probabilities as a noisy-or: no gain where the trees are sure of a failure."""
    return np.asarray(trees + (1 - trees) * LINEAR_TRUST * linear)
