"""Models of the probability that a test fails, learnt from tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.core.samplers.meta_model import scaled
from pipeline.core.space import Floats

TREE_FEATURES = 0.7
"""Share of the inputs that a tree tries at each of its nodes."""
LINEAR_TRUST = 0.75
"""What the linear model's probability counts where the trees expect no failure."""
EDGE = 1e-9


def tree_chances(inputs: Floats, failed: NDArray[np.bool_], others: Floats, trees: int, rng: np.random.Generator) -> Floats:
    """The failure probability of other inputs (m, f) by each of some extremely randomised trees, (trees, m) (Geurts et al., 2006).

    inputs: (n, f). failed: (n,) whether those tests failed.
    """
    from sklearn import config_context  # Takes seconds, and every study makes every strategy to check it.
    from sklearn.tree import ExtraTreeRegressor

    # The trees of scikit-learn's ExtraTreesRegressor, bit for bit, without the copies and checks that it makes of each.
    seeds = np.random.RandomState(int(rng.integers(2**31))).randint(2**31 - 1, size=trees)
    known, values, rows = inputs.astype(np.float32), failed.astype(float), others.astype(np.float32)
    with config_context(skip_parameter_validation=True):
        grown = [
            ExtraTreeRegressor(max_features=TREE_FEATURES, random_state=s).fit(known, values, check_input=False) for s in seeds.tolist()
        ]
    return np.stack([tree.tree_.predict(rows)[:, 0] for tree in grown])


def linear_chances(inputs: Floats, kpi: Floats, threshold: float, others: Floats) -> Floats:
    """The probability (m,) that the KPI of other inputs is at or below the threshold, by a Bayesian linear model with normal scatter
    (Tipping, 2001)."""
    from scipy.special import ndtr
    from sklearn.linear_model import BayesianRidge

    *observed, limit = scaled(np.append(kpi, threshold))
    mean, deviation = BayesianRidge().fit(inputs, observed).predict(others, return_std=True)
    return np.asarray(ndtr((limit - mean) / np.maximum(deviation, EDGE)))


def joined(trees: Floats, linear: Floats) -> Floats:
    """Both models' probabilities as a noisy-or: what the trees know to fail cannot gain from the linear model."""
    return np.asarray(trees + (1 - trees) * LINEAR_TRUST * linear)
