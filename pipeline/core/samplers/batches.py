"""The base of all strategies: batches by ask and tell, with the history as the only state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

import numpy as np

from pipeline.core.space import Floats, Space


@dataclass(eq=False, repr=False)
class BatchSampler(ABC):
    """A strategy that chooses tests in batches (thesis Def. 4.14), by ask and tell.

    A new strategy implements `_choose`; its dataclass fields are its parameters.

    The i-th batch depends only on the seed, on i and on the history before it. So telling the rows
    of a journal again, in the order asked and in portions of any length, restores the sampler, and
    asking twice gives the same points. In the middle of a batch `ask` returns the rest of it. A
    batch is always full: on a finite space with fewer points than the budget, strategies that want
    untested points draw repetitions at random once all points are tested.

    Args:
        space: the space to sample; no point breaks its constraints.
        seed: from 0.
        batch_size: tests per batch, in [1, 1000].

    Raises:
        ValueError: if a parameter is out of range.
    """

    independent: ClassVar[bool] = False
    """Whether the points are independent samples of the space.

    If so, a binomial interval of the failure rate holds."""
    learns: ClassVar[bool] = True
    """Whether the points depend on results.

    If not, a campaign may be split into shards that do not share their results."""

    space: Space
    seed: int
    _: KW_ONLY
    batch_size: int = 20

    def __post_init__(self) -> None:
        self.limit("[1, 1000]", "batch_size")
        self.limit("[0, inf)", "seed")
        self._points: Floats = np.zeros((0, len(self.space)))
        self._kpi: Floats = np.zeros(0)
        self._batch: tuple[int, Floats] | None = None

    def limit(self, interval: str, *names: str) -> None:
        """Check that parameters are inside an interval, such as `[0, 1]` or `(0, 10]`.

        Raises:
            ValueError: names the parameter, the interval and the value.
        """
        low, high = map(float, interval[1:-1].split(", "))
        for name in names:
            value = getattr(self, name)
            above = low < value or (value == low and interval[0] == "[")
            below = value < high or (value == high and interval[-1] == "]")
            if not (above and below):
                raise ValueError(f"{name} must be in {interval}, got {value}")

    def ask(self) -> Floats:
        """The points of the current batch that have no result yet, (b, d), b at least 1."""
        index, done = divmod(len(self._points), self.batch_size)
        if self._batch is None or self._batch[0] != index:
            begin = index * self.batch_size
            rng = np.random.default_rng([self.seed, index])
            self._batch = index, self._choose(index, self._points[:begin], self._kpi[:begin], rng)
        return self._batch[1][done:].copy()

    def tell(self, points: Floats, kpi: Floats) -> None:
        """Record the KPI of asked points, in the order asked.

        Args:
            points: (b, d).
            kpi: (b,), NaN for an error.

        Raises:
            ValueError: if the shapes do not fit.
        """
        if points.shape != (len(kpi), len(self.space)):
            raise ValueError(
                f"points must have shape ({len(kpi)}, {len(self.space)}), got {points.shape}"
            )
        self._points = np.concatenate([self._points, points])
        self._kpi = np.concatenate([self._kpi, kpi])

    @abstractmethod
    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        """The batch with this index, (batch_size, d).

        Args:
            index: number of the batch, from 0.
            points: (n, d) all tests before the batch.
            kpi: (n,) their KPIs, NaN for an error.
            rng: a generator for this batch alone.
        """
