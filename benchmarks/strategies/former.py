"""The search that `forest` replaced: `neural`, the default of release 0.2, as it was with its shipped settings."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor

from pipeline.core.distance import mixed_distance, relevance
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.features import features
from pipeline.core.space import Floats

GRID = (((16,), 1e-2), ((32,), 1e-2), ((16, 16), 1e-1), ((32, 16), 1e-2))
"""Hidden layers and L2 penalty."""
TUNE_EVERY = 3
CANDIDATES, MUTANTS, PARENTS = 1000, 0.4, 12
EXPLORE = 0.2
EPSILON, OMEGA_THRESHOLD, SPREAD = 0.25, -3, 0.2


@dataclass(eq=False, repr=False, kw_only=True)
class Neural(BatchSampler):
    """Network regression on uniform candidates and on mutants of the worst tests; the points of a batch keep a distance.

    failure_threshold_s: a KPI at or below it is a failure.
    """

    failure_threshold_s: float = 0.1

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        valid = np.isfinite(kpi)
        seen, values = points[valid], kpi[valid]
        if len(values) < 8:
            return self.space.sample(self.batch_size, rng)
        candidates = self._candidates(seen, values, rng)
        omega = relevance(self.space, candidates, seen, values <= self.failure_threshold_s, EPSILON)
        relevant = np.flatnonzero(omega > OMEGA_THRESHOLD)
        predicted = self._predict(
            index, features(self.space, seen), values, features(self.space, candidates)
        )
        explored = round(EXPLORE * self.batch_size)
        order = relevant[np.argsort(predicted[relevant], kind="stable")]
        chosen = self._apart(candidates, order, self.batch_size - explored)
        others = rng.permutation(np.setdiff1d(relevant, chosen))[:explored]
        picked = candidates[np.concatenate([chosen, others]).astype(np.int64)]
        return np.concatenate([picked, self.space.sample(self.batch_size - len(picked), rng)])

    def _candidates(self, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        """Uniform points, and mutants of the tests with the lowest KPI: one to three variables drawn anew."""
        count = round(MUTANTS * CANDIDATES)
        uniform = self.space.sample(CANDIDATES - count, rng)
        parents = points[np.argsort(kpi, kind="stable")[:PARENTS]]
        children = parents[rng.integers(len(parents), size=count)]
        fresh = self.space.sample(count, rng)
        changed = rng.random(children.shape).argsort(axis=1) < rng.integers(1, 4, size=(count, 1))
        children = np.where(changed, fresh, children)
        feasible = self.space.constraints.holds(self.space.categorise(children))
        return np.concatenate([uniform, np.where(feasible[:, None], children, fresh)])

    def _apart(self, candidates: Floats, order: NDArray[np.int64], count: int) -> NDArray[np.int64]:
        """The first `count` of `order` that keep `SPREAD` from those already chosen."""
        chosen: list[int] = []
        for i in order:
            if len(chosen) == count:
                break
            if (
                not chosen
                or mixed_distance(self.space, candidates[[i]], candidates[chosen]).min() >= SPREAD
            ):
                chosen.append(int(i))
        return np.array(chosen, dtype=np.int64)

    def _predict(self, index: int, inputs: Floats, kpi: Floats, candidates: Floats) -> Floats:
        target = kpi / max(float(kpi.max()), 1e-9)
        # Tuned on the history at the last grid search.
        tuned = max(len(inputs) - (index % TUNE_EVERY) * self.batch_size, 8)
        layers, penalty = self._tune(index - index % TUNE_EVERY, inputs[:tuned], target[:tuned])
        return np.asarray(
            _fit(layers, penalty, inputs, target, self.seed + index).predict(candidates),
            dtype=float,
        )

    def _tune(self, index: int, inputs: Floats, target: Floats) -> tuple[tuple[int, ...], float]:
        order = np.random.default_rng([self.seed, index, 1]).permutation(len(inputs))
        cut = max(1, round(0.25 * len(order)))
        test, development = order[:cut], order[cut:]
        fitted = (
            _fit(layers, penalty, inputs[development], target[development], self.seed + index)
            for layers, penalty in GRID
        )
        return GRID[
            int(
                np.argmin(
                    [
                        np.mean((network.predict(inputs[test]) - target[test]) ** 2)
                        for network in fitted
                    ]
                )
            )
        ]


def _fit(
    layers: tuple[int, ...], penalty: float, inputs: Floats, target: Floats, seed: int
) -> MLPRegressor:
    network = MLPRegressor(
        hidden_layer_sizes=layers, alpha=penalty, solver="lbfgs", max_iter=60, random_state=seed
    )
    with warnings.catch_warnings():
        # Stopping after 60 steps is the regularisation.
        warnings.simplefilter("ignore", ConvergenceWarning)
        return network.fit(inputs, target)


SAMPLERS = {"neural": Neural}
