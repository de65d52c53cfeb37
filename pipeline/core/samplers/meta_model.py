"""Meta-model testing: the tests that a regression predicts to be the worst.

Source: thesis Algorithm 2, section 4.4.3.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pipeline.core.distance import relevance
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.features import features
from pipeline.core.samplers.untested import fill, untested
from pipeline.core.space import Floats

TEST_SHARE = 0.25
"""Share of the tests on which hyperparameters are compared."""
ENOUGH = 8
"""Fewest tests that are split for a comparison; with fewer, the first hyperparameters apply."""

MetaModel = Callable[[Floats], tuple[Floats, Floats]]
"""From inputs (n, f) to the scaled KPI (n,) and the standard deviation of each prediction (n,).

The deviation is 0 if the model has none."""
Hyperparameters = Mapping[str, Any]


@dataclass(eq=False, repr=False, kw_only=True)
class MetaModelSampler(BatchSampler):
    """Fits a regression of the KPI and tests the candidates with the lowest prediction.

    The first batch is random. Then each batch chooses the hyperparameters, fits the model to all
    tests, predicts a fixed-size candidate set (FSCS) of uniform, untested points and takes from its
    sampling-relevant ones (Def. 4.20) the lowest b1 and b2 others at random. If too few candidates
    are relevant, random tests fill the batch. The inputs are numbers and one-hot categories.

    The thesis gives no size of the set, no b1 and b2, and no grid.

    Args:
        space, seed, batch_size: as for `BatchSampler`.
        candidates: size of the candidate set, in [batch_size, 100000].
        explore: b2 as a share of the batch, in [0, 1].
        failure_threshold_s: a KPI at or below it is a failure, in (0, 10] s.
        epsilon: radius of the ball, on the mixed distance, in (0, 10].
        omega_threshold: a candidate is relevant above it, in [-100000, 0).
        tune_every: batches from one choice of hyperparameters to the next, in [1, 1000]; the thesis
            has 1.

    Raises:
        ValueError: if a parameter is out of range.
    """

    grid: ClassVar[tuple[Hyperparameters, ...]] = ({},)
    """The hyperparameters to choose from."""

    candidates: int = 1000
    explore: float = 0.2
    failure_threshold_s: float = 0.1
    epsilon: float = 0.1
    omega_threshold: int = -5
    tune_every: int = 5

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.candidates < self.batch_size:
            raise ValueError(
                f"candidates must be at least batch_size, {self.batch_size}, got {self.candidates}"
            )
        self.limit("[1, 100000]", "candidates")
        self.limit("[0, 1]", "explore")
        self.limit("(0, 10]", "failure_threshold_s")
        self.limit("(0, 10]", "epsilon")
        self.limit("[-100000, 0)", "omega_threshold")
        self.limit("[1, 1000]", "tune_every")
        self._tuned: tuple[int, Hyperparameters] = (0, self.grid[0])

    @abstractmethod
    def fit(
        self, inputs: Floats, kpi: Floats, hyperparameters: Hyperparameters, seed: int
    ) -> MetaModel:
        """Fit the model; equal arguments give equal models.

        Args:
            inputs: (n, f), n at least 1.
            kpi: (n,) KPIs scaled to [0, 1].
            hyperparameters: an element of `grid`.
            seed: seed of the fit's random draws.
        """

    def rank(self, kpi: Floats, deviation: Floats) -> Floats:
        """The order in which candidates are tested, lowest first, (n,): here the predicted KPI.

        Args:
            kpi: (n,) predicted KPI of each candidate.
            deviation: (n,) standard deviation of each prediction.
        """
        return kpi

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        observed = ~np.isnan(kpi)
        if not observed.any():
            return fill(self.space, np.zeros((0, len(self.space))), points, self.batch_size, rng)
        candidates = self.space.sample(self.candidates, rng)
        candidates = candidates[untested(candidates, points)]
        failures = kpi[observed] <= self.failure_threshold_s
        omega = relevance(self.space, candidates, points[observed], failures, self.epsilon)
        relevant = candidates[omega > self.omega_threshold]
        order = np.arange(0)
        if len(relevant):
            hyperparameters = self._hyperparameters(index, points, kpi)
            inputs, values = self._inputs(points[observed]), scaled(kpi[observed])
            model = self.fit(inputs, values, hyperparameters, self.seed + index)
            order = np.argsort(self.rank(*model(self._inputs(relevant))), kind="stable")
        randoms = round(self.explore * self.batch_size)
        lowest, others = np.split(order, [min(self.batch_size - randoms, len(order))])
        chosen = relevant[np.concatenate([lowest, rng.permutation(others)[:randoms]])]
        return fill(self.space, chosen, points, self.batch_size, rng)

    def _hyperparameters(self, index: int, points: Floats, kpi: Floats) -> Hyperparameters:
        """Those chosen at the last batch that was due, from the history at that time.

        So a replay needs no further state.
        """
        due = index - (index - 1) % self.tune_every
        if self._tuned[0] != due:
            before = slice(due * self.batch_size)
            observed = ~np.isnan(kpi[before])
            inputs = self._inputs(points[before][observed])
            values = scaled(kpi[before][observed])
            self._tuned = due, self.tune(inputs, values, self.seed + due)
        return self._tuned[1]

    def tune(self, inputs: Floats, kpi: Floats, seed: int) -> Hyperparameters:
        """The hyperparameters with the least mean squared error on a random test set.

        Args: as for `fit`.
        """
        if len(self.grid) == 1 or len(inputs) < ENOUGH:
            return self.grid[0]
        order = np.random.default_rng([seed, 1]).permutation(len(inputs))
        test, development = np.split(order, [round(TEST_SHARE * len(order))])
        errors = []
        for hyperparameters in self.grid:
            model = self.fit(inputs[development], kpi[development], hyperparameters, seed)
            errors.append(np.mean((model(inputs[test])[0] - kpi[test]) ** 2))
        return self.grid[int(np.argmin(errors))]

    def _inputs(self, points: Floats) -> Floats:
        return features(self.space, points, attributes=False)


def scaled(kpi: Floats) -> Floats:
    """Scale KPIs to [0, 1] from the lowest to the highest (Def. 4.21).

    A single very high KPI would make all others look alike. So KPIs, infinite ones too, are clipped
    at the lowest plus four times the distance from there to the third quartile. Equal KPIs are all
    0.5.

    Args:
        kpi: (n,), infinite ones included, but no NaN.

    >>> scaled(np.array([0.0, 1.0, 2.0, np.inf])).tolist()
    [0.0, 0.5, 1.0, 1.0]
    """
    finite = kpi[np.isfinite(kpi)]
    if not len(finite) or np.ptp(finite) == 0:
        return np.where(np.isfinite(kpi), 0.5, np.sign(kpi) / 2 + 0.5)
    low, quartile = finite.min(), np.quantile(finite, 0.75)
    high = min(finite.max(), low + 4 * (quartile - low)) if quartile > low else finite.max()
    return np.asarray((np.clip(kpi, low, high) - low) / (high - low))
