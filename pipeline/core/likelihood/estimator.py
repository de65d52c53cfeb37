"""The base of all estimators of a failure rate: they choose tests and compute the rate."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.core.exposure import Exposure
from pipeline.core.likelihood.rate import Limits, Rate
from pipeline.core.space import Floats, Space


@dataclass(eq=False, repr=False, kw_only=True)
class Estimator(ABC):
    """Estimates how often tests fail under an exposure (thesis Def. 4.11), by ask and tell.

    A new estimator implements `ask` and `rate`. Its state is its history: telling the same rows
    again, in the batches asked, restores it. Only the last batch may be told in part. Once the rate
    is certain enough, `ask` returns no point.

    Args:
        space: of the scenario.
        seed: from 0.
        exposure: see `Exposure.from_dict`.
        budget: most tests, at least 100.
        failure_threshold_s: a KPI at or below it is a failure (Def. 4.10).
        batch_size: tests per batch.

    Raises:
        ValueError: if the seed or the budget is out of range, or the exposure does not fit.
    """

    space: Space
    seed: int
    exposure: Mapping[str, Any]
    budget: int
    failure_threshold_s: float = 0.1
    batch_size: int = 20

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"seed must be at least 0, got {self.seed}")
        if self.budget < 100:
            raise ValueError(f"budget must be at least 100 tests, got {self.budget}")
        self._exposure = Exposure.from_dict(self.space, self.exposure)
        self._kpi: Floats = np.zeros(0)

    @abstractmethod
    def ask(self) -> Floats:
        """The next points to test, (b, d); none, (0, d), when no further test will be used."""

    def tell(self, points: Floats, kpi: Floats) -> None:
        """Record the KPI of asked points, in the order asked.

        Args:
            points: (b, d).
            kpi: (b,), NaN for an error.
        """
        self._kpi = np.concatenate([self._kpi, kpi])

    @abstractmethod
    def rate(self) -> Rate:
        """The rate after the tests so far."""

    def _rng(self) -> np.random.Generator:
        """The generator of the next batch: it depends on the seed and the number of tests alone."""
        return np.random.default_rng([self.seed, len(self._kpi)])

    @property
    def _none(self) -> Floats:
        return np.zeros((0, len(self.space)))

    @property
    def _errors(self) -> int:
        return int(np.isnan(self._kpi).sum())

    @property
    def _tests(self) -> int:
        """Tests without an error."""
        return len(self._kpi) - self._errors

    @property
    def _failures(self) -> int:
        return int((self._kpi <= self.failure_threshold_s).sum())

    def _rate(self, value: float, limits: Limits, note: str = "") -> Rate:
        return Rate(value, limits, self._tests, self._failures, self._errors, note)
