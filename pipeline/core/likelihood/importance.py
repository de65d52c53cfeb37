"""Importance sampling: more tests where a meta-model expects failures.

Each test is weighted by how often the road shows it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.failure_model import joined, linear_chances, tree_chances
from pipeline.core.likelihood.estimator import Estimator
from pipeline.core.likelihood.rate import Rate, bounded, exact, spread
from pipeline.core.samplers.features import features
from pipeline.core.space import Floats, Ints

ENOUGH_FAILURES = 20
"""Random failures before the meta-model chooses.

A failure mode with a fifth of them is missed once in a hundred times."""
DEFENSIVE = 0.2
"""Share of later tests drawn from the exposure itself, so that no weight exceeds 1 / DEFENSIVE."""
GROWTH = 1.25
"""The meta-model is fitted again after this many times as many tests."""
FEW = "too few failures in the first half of the budget for a meta-model, so all tests were random"


@dataclass(eq=False, repr=False, kw_only=True)
class ImportanceSampling(Estimator):
    """Tests where a meta-model expects failures, and weights them so that the rate is unbiased.

    First, random tests of the exposure, until 20 fail or half of the budget is spent; they train
    the meta-model and enter no rate. Then each batch comes from a pool of random points of the
    exposure. A point is chosen with a probability of 0.2 / n + 0.8 s / Σ s, where s is its failure
    probability by the meta-model: a defensive mixture (Hesterberg 1995). Its weight is the uniform
    probability 1 / n over that, at most 5. The pool is itself a random sample of the exposure, so
    no density is needed, and categories and constraints are no problem.

    The interval has the variance of the weights and that of the pools. If the weights of the
    failures are worth fewer than 20 equal ones, the interval is that of `bounded`, which holds
    whatever weights unseen failures have. If half of the budget shows fewer failures, all tests are
    random and the interval is that of `exact`. The other parameters are those of `Estimator`.

    Args:
        pool: points of a pool.
        trees: trees of the meta-model.
    """

    pool: int = 20_000
    trees: int = 60

    def __post_init__(self) -> None:
        super().__post_init__()
        self._points: Floats = self._none
        self._weights: Floats = np.zeros(0)
        self._asked_weights: Floats = np.zeros(0)
        self._random = 0
        self._pools: list[tuple[Floats, Floats]] = []
        self._pool_of: Ints = np.zeros(0, int)
        self._fitted = 0

    def ask(self) -> Floats:
        if len(self._kpi) >= self.budget:
            return self._none
        rng = self._rng()
        if self._learning:
            self._asked_weights = np.ones(self.batch_size)
            return self._exposure.sample(self.batch_size, rng)
        if len(self._kpi) >= self._fitted * GROWTH:
            self._fit()
        points, chances = self._pools[-1]
        chosen = rng.choice(len(points), self.batch_size, p=chances)
        self._asked_weights = 1 / (len(points) * chances[chosen])
        return points[chosen]

    def tell(self, points: Floats, kpi: Floats) -> None:
        self.ask()  # Sets the weights of these points, even if another instance asked for them.
        if self._learning:
            self._random += len(kpi)
        super().tell(points, kpi)
        self._points = np.concatenate([self._points, points])
        self._weights = np.concatenate([self._weights, self._asked_weights[: len(kpi)]])
        self._pool_of = np.concatenate([self._pool_of, np.full(len(kpi), len(self._pools))])

    def rate(self) -> Rate:
        if self._random == len(self._kpi):
            limits = exact(self._failures, self._tests)
            return self._rate(self._failures / max(self._tests, 1), limits, FEW)
        later = np.arange(len(self._kpi)) >= self._random
        valid = ~np.isnan(self._kpi) & later
        failed = self._weights[valid & (self._kpi <= self.failure_threshold_s)]
        tests = float(valid.sum())
        if valid.sum() < later.sum():
            # This rate covers error-free conditions only, which a search for failures samples at a
            # different rate than traffic does.
            tests = float(later.sum() * self._weights[valid].sum() / self._weights[later].sum())
        if not len(failed) or failed.sum() ** 2 < ENOUGH_FAILURES * (failed @ failed):
            limits = bounded(failed, 1 / DEFENSIVE, max(tests, 1))
            return self._rate(min(1.0, float(failed.sum()) / max(tests, 1)), limits)
        value = min(1.0, float(failed.sum()) / tests)
        # Each pool is itself a sample, whose error all tests from it share.
        shares = np.bincount(self._pool_of[valid]) / valid.sum()
        pools = value * max(1 - value, 1 / tests) / self.pool * float(shares @ shares)
        variance = max(float(failed @ failed) / tests - value**2, 0.0) / tests + pools
        return self._rate(value, spread(value, value**2 / variance))

    @property
    def _learning(self) -> bool:
        """Whether the next tests are random.

        They are until there are enough failures, and forever if half of the budget shows too few.
        """
        return self._random == len(self._kpi) and (
            self._failures < ENOUGH_FAILURES or len(self._kpi) > self.budget / 2
        )

    def _fit(self) -> None:
        """Fit the meta-model to all tests, and weigh a new pool by it."""
        # Not the generator of the batch: asking twice fits once.
        rng = np.random.default_rng([self.seed, len(self._kpi), 1])
        valid = ~np.isnan(self._kpi)
        inputs, kpi = features(self.space, self._points[valid]), self._kpi[valid]
        points = self._exposure.sample(self.pool, rng)
        others = features(self.space, points)
        forest = tree_chances(inputs, kpi <= self.failure_threshold_s, self.trees, rng)
        trees = forest(others).mean(axis=0)
        score = joined(trees, linear_chances(inputs, kpi, self.failure_threshold_s)(others)) + 1e-12
        chances = DEFENSIVE / len(points) + (1 - DEFENSIVE) * score / score.sum()
        self._pools.append((points, chances / chances.sum()))
        self._fitted = len(self._kpi)
