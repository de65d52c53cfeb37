"""Monte Carlo: random tests of the exposure, counted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.likelihood.estimator import Estimator
from pipeline.core.likelihood.rate import TAIL, Rate, anytime, evidence, exact
from pipeline.core.space import Floats


@dataclass(eq=False, repr=False, kw_only=True)
class MonteCarlo(Estimator):
    """Draws independent tests of the exposure.

    Their failures are binomial, so the interval is exact. The other parameters are those of
    `Estimator`.

    Args:
        below: a limit of the rate, in (0, 1). With it, the tests stop as soon as the rate is
            certainly below or above it, and the interval allows for the check after every batch.
    """

    below: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.below is not None and not 0 < self.below < 1:
            raise ValueError(f"below must be in (0, 1), got {self.below}")

    def ask(self) -> Floats:
        settled = len(self._kpi) >= self.budget
        if self.below is not None:
            # Whether the evidence suffices that the rate is below the limit, or above it.
            counts = (self._failures, self._tests, self.below)
            under, over = evidence(*counts, above=False), evidence(*counts, above=True)
            settled = settled or bool(under > -np.log(2 * TAIL) or over > -np.log(TAIL))
        if settled:
            return self._none
        return self._exposure.sample(self.batch_size, self._rng())

    def rate(self) -> Rate:
        limits = (exact if self.below is None else anytime)(self._failures, self._tests)
        return self._rate(self._failures / max(self._tests, 1), limits)
