"""Pair-wise testing: a covering array as a frozen sequence of tests (thesis section 4.4.1)."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.space import Floats


class PairwiseSampler(BatchSampler):
    """Executes a covering array in the order that covers new pairs soonest, then random tests.

    It ignores test results. The sequence depends only on space and seed, so versions under
    comparison execute the same tests.
    """

    learns = False

    @cached_property
    def plan(self) -> Floats:
        """The covering array in the order of execution, (rows, d).

        The points are the representatives of their categories.
        """
        # Takes long to import, and every study constructs every strategy.
        from pipeline.core.coverage.arrays import covering_array, order_by_new_pairs

        rows = covering_array(self.space.constraints, min(2, len(self.space)), seed=self.seed).rows
        return self.space.representatives(rows[order_by_new_pairs(rows)])

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        planned = self.plan[index * self.batch_size : (index + 1) * self.batch_size]
        return np.concatenate([planned, self.space.sample(self.batch_size - len(planned), rng)])
