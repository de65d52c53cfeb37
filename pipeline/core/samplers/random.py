"""Random testing: the baseline (thesis Table 6.1, row 1)."""

from __future__ import annotations

import numpy as np

from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.space import Floats


class RandomSampler(BatchSampler):
    """Draws every variable independently and uniformly; ignores test results."""

    independent = True
    learns = False

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        return self.space.sample(self.batch_size, rng)
