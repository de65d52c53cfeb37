"""The base of all strategies: batches by ask and tell, with the history as the only state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

import numpy as np

from pipeline.core.space import Floats, Space


@dataclass(eq=False, repr=False)
class BatchSampler(ABC):
    """A strategy that chooses tests in batches (thesis Def. 4.14), by ask and tell; its fields are its parameters.

    The i-th batch depends only on the seed, on i and on the history before it. So telling the rows of a journal again, in the order asked
    and in portions of any length, restores the sampler, and asking twice gives the same points. In the middle of a batch `ask` returns the
    rest of it. A batch is always full: on a finite space with fewer points than the budget, strategies that want untested points draw
    repetitions at random once all points are tested.

    space: the space to sample; no point breaks its constraints. seed: from 0. batch_size: tests per batch, 1 to 1000.
    """

    independent: ClassVar[bool] = False
    """Whether the points are independent samples of the space, so that a binomial interval of the failure rate holds."""
    learns: ClassVar[bool] = True
    """Whether the points depend on results. If not, a campaign may be split into shards, each of which knows only its own results."""

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
        """ValueError for a parameter outside an interval, such as `[0, 1]` or `(0, 10]`."""
        low, high = map(float, interval[1:-1].split(", "))
        for name in names:
            value = getattr(self, name)
            inside = (low < value or (value == low and interval[0] == "[")) and (
                value < high or (value == high and interval[-1] == "]")
            )
            if not inside:
                raise ValueError(f"{name} must be in {interval}, got {value}")

    def ask(self) -> Floats:
        """The points of the current batch that have no result yet, (b, d), 1 to `batch_size` of them."""
        index, told = divmod(len(self._points), self.batch_size)
        if self._batch is None or self._batch[0] != index:
            begin = index * self.batch_size
            rng = np.random.default_rng([self.seed, index])
            self._batch = index, self._choose(index, self._points[:begin], self._kpi[:begin], rng)
        return self._batch[1][told:].copy()

    def tell(self, points: Floats, kpi: Floats) -> None:
        """Record the KPI of asked points, in the order asked: (b, d) and (b,), NaN for an error."""
        if points.shape != (len(kpi), len(self.space)):
            raise ValueError(
                f"points must have shape ({len(kpi)}, {len(self.space)}), got {points.shape}"
            )
        self._points = np.concatenate([self._points, points])
        self._kpi = np.concatenate([self._kpi, kpi])

    @abstractmethod
    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        """The `index`-th batch, (batch_size, d), given all tests (n, d) and KPIs (n,) before it."""
