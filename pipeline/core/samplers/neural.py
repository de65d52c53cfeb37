"""Meta-model testing with a neural network (thesis Algorithm 2, section 4.4.3)."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor
from sklearn.tree import DecisionTreeRegressor

from pipeline.core.distance import mixed_distance, relevance
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.features import features
from pipeline.core.space import Floats

GRID: tuple[tuple[tuple[int, ...], float], ...] = (((16,), 1e-2), ((32,), 1e-2), ((16, 16), 1e-1), ((32, 16), 1e-2))
"""Grid of hyperparameters: hidden layers and L2 penalty."""
TUNE_EVERY = 3
"""Batches between grid searches: more frequent searches cost more and change little."""
TEST_SHARE = 0.25
PARENTS = 12
MIN_LEAF = 4
"""Smallest number of tests of a kind."""


@dataclass(eq=False, repr=False, kw_only=True)
class NeuralSampler(BatchSampler):
    """Fits a network to the KPI and tests where it predicts the lowest values, with a share of random exploration.

    Each batch: a grid search chooses the network by its error on a held-out quarter of the tests; the network then predicts a fixed-size
    candidate set. Only sampling-relevant candidates are eligible (Def. 4.20), so the search leaves an established failure region. Beyond
    the thesis, a share of the candidates are mutations of the worst tests so far (one to three variables drawn anew), because uniform
    candidates rarely hit a narrow region, and the points of a batch keep a distance from each other. If the space has attributes of
    categories, they are inputs of the network, so a failure with one pedestrian raises the prediction for similar ones. Each kind of tests,
    a leaf of a regression tree on the KPI, gets a share of the batch; otherwise the most common cause would take it all. Tests of earlier
    campaigns on other scenarios can be inputs, so causes too rare for one campaign are known.

    candidates: size of the candidate set. mutants: its share of mutations, in [0, 1). explore: share of a batch drawn at random, in [0, 1].
    failure_threshold_s: a KPI at or below it is a failure. epsilon: radius of the ball, on the mixed distance. omega_threshold: negative; a
    candidate is relevant above it. spread: smallest distance within a batch. kinds: largest number of kinds; 1 disables the sharing.
    earlier: points (m, d) and KPI (m,) of each earlier campaign; relevance (Def. 4.20) counts only this campaign's tests.
    """

    candidates: int = 1000
    mutants: float = 0.4
    explore: float = 0.2
    failure_threshold_s: float = 0.1
    epsilon: float = 0.1
    omega_threshold: int = -5
    spread: float = 0.05
    kinds: int = 1
    earlier: Sequence[tuple[Floats, Floats]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.candidates < self.batch_size:
            raise ValueError(f"candidates must be at least batch_size, {self.batch_size}, got {self.candidates}")
        if not 0 <= self.mutants < 1 or not 0 <= self.explore <= 1:
            raise ValueError(f"mutants must be in [0, 1) and explore in [0, 1], got {self.mutants} and {self.explore}")
        if self.omega_threshold >= 0:
            raise ValueError(f"omega_threshold must be negative, got {self.omega_threshold}")
        if self.kinds < 1:
            raise ValueError(f"kinds must be at least 1, got {self.kinds}")

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        valid = np.isfinite(kpi)
        seen, values, campaign = self._known(points, kpi)
        if len(values) < 8:
            return self.space.sample(self.batch_size, rng)
        candidates = self._candidate_set(seen, values, rng)
        omega = relevance(self.space, candidates, points[valid], kpi[valid] <= self.failure_threshold_s, self.epsilon)
        relevant = np.flatnonzero(omega > self.omega_threshold)
        predicted = self._predict(index, self._inputs(seen, campaign), values, self._inputs(candidates, len(self.earlier)))
        random_count = round(self.explore * self.batch_size)
        order = relevant[np.argsort(predicted[relevant], kind="stable")]
        chosen = self._spread_out(candidates, order, self._kinds_of(index, seen, values, candidates), self.batch_size - random_count)
        others = np.setdiff1d(relevant, chosen)
        explored = rng.permutation(others)[:random_count]
        picked = candidates[np.concatenate([chosen, explored]).astype(np.int64)]
        # If too few candidates are relevant, random testing fills the batch.
        return np.concatenate([picked, self.space.sample(self.batch_size - len(picked), rng)])

    def _known(self, points: Floats, kpi: Floats) -> tuple[Floats, Floats, NDArray[np.int64]]:
        """The valid tests, those of earlier campaigns first: points (n, d), KPI (n,), and the position of each test's campaign (n,)."""
        campaigns = [*self.earlier, (points, kpi)]
        campaign = np.repeat(np.arange(len(campaigns)), [len(values) for _, values in campaigns])
        points, kpi = (np.concatenate(parts) for parts in zip(*campaigns, strict=True))
        valid = np.isfinite(kpi)
        return points[valid], kpi[valid], campaign[valid]

    def _candidate_set(self, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        """Uniform points, and mutations of the tests with the lowest KPI."""
        count = round(self.mutants * self.candidates)
        uniform = self.space.sample(self.candidates - count, rng)
        parents = points[np.argsort(kpi, kind="stable")[:PARENTS]]
        children = parents[rng.integers(len(parents), size=count)]
        fresh = self.space.sample(count, rng)
        changed = rng.random(children.shape).argsort(axis=1) < rng.integers(1, 4, size=(count, 1))
        children = np.where(changed, fresh, children)
        feasible = self.space.constraints.holds(self.space.categorise(children))
        return np.concatenate([uniform, np.where(feasible[:, None], children, fresh)])

    def _kinds_of(self, index: int, points: Floats, kpi: Floats, candidates: Floats) -> NDArray[np.int64]:
        """The kind of each candidate: its leaf in a regression tree on the KPI of the tests."""
        if self.kinds == 1:
            return np.zeros(len(candidates), dtype=np.int64)
        tree = DecisionTreeRegressor(max_leaf_nodes=self.kinds, min_samples_leaf=MIN_LEAF, random_state=self.seed + index)
        leaves = tree.fit(features(self.space, points), kpi).apply(features(self.space, candidates))
        return np.asarray(leaves, dtype=np.int64)

    def _spread_out(self, candidates: Floats, order: NDArray[np.int64], kinds: NDArray[np.int64], count: int) -> NDArray[np.int64]:
        """The first `count` of `order` that keep `spread` from those already chosen and exceed no kind's equal share."""
        chosen: list[int] = []
        share, taken = -(-count // self.kinds), Counter[int]()
        for i in order:
            if len(chosen) == count:
                break
            if taken[kinds[i]] == share:
                continue
            if not chosen or mixed_distance(self.space, candidates[[i]], candidates[chosen]).min() >= self.spread:
                chosen.append(int(i))
                taken[kinds[i]] += 1
        return np.array(chosen, dtype=np.int64)

    def _predict(self, index: int, features: Floats, kpi: Floats, candidates: Floats) -> Floats:
        """The predicted KPI of the candidates; every random choice depends on (seed, index) alone."""
        target = kpi / max(float(kpi.max()), 1e-9)
        # Tuned on the history at the last grid search, so a replay needs no extra state.
        tuned = len(features) - (index % TUNE_EVERY) * self.batch_size
        layers, penalty = self._tune(index - index % TUNE_EVERY, features[: max(tuned, 8)], target[: max(tuned, 8)])
        network = _fit(layers, penalty, features, target, self.seed + index)
        return np.asarray(network.predict(candidates), dtype=float)

    def _tune(self, index: int, features: Floats, target: Floats) -> tuple[tuple[int, ...], float]:
        order = np.random.default_rng([self.seed, index, 1]).permutation(len(features))
        cut = max(1, round(TEST_SHARE * len(order)))
        test, development = order[:cut], order[cut:]
        errors = []
        for layers, penalty in GRID:
            network = _fit(layers, penalty, features[development], target[development], self.seed + index)
            errors.append(float(np.mean((network.predict(features[test]) - target[test]) ** 2)))
        return GRID[int(np.argmin(errors))]

    def _inputs(self, points: Floats, campaign: NDArray[np.int64] | int) -> Floats:
        """The network's inputs: the features and, with earlier campaigns, the campaign one-hot."""
        inputs = features(self.space, points)
        if not self.earlier:
            return inputs
        positions = np.broadcast_to(campaign, len(points))
        return np.column_stack([inputs, positions[:, None] == np.arange(len(self.earlier) + 1)])


def _fit(layers: tuple[int, ...], penalty: float, features: Floats, target: Floats, seed: int) -> MLPRegressor:
    network = MLPRegressor(hidden_layer_sizes=layers, alpha=penalty, solver="lbfgs", max_iter=60, random_state=seed)
    with warnings.catch_warnings():
        # Stopping after 60 steps is the regularisation.
        warnings.simplefilter("ignore", ConvergenceWarning)
        network.fit(features, target)
    return network
