"""Coverage-guided testing: each batch covers most k-tuples of categories that were not covered yet (Cheng et al., Definition 5)."""

from __future__ import annotations

import numpy as np

from pipeline.core.constraints import Constraints
from pipeline.core.coverage.proposals import Proposer
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.space import Floats, Space


class CoverageSampler(BatchSampler):
    """Proposes categories that raise k-projection coverage most, and draws a value inside each; learns nothing from results.

    Once every feasible k-tuple has been tested, each is wanted once more, and so on.
    """

    def __init__(self, space: Space, seed: int, *, batch_size: int = 20, k: int = 2, constraints: Constraints | None = None) -> None:
        """k: categories that are looked at together, 1 to the number of variables."""
        super().__init__(space, seed, batch_size=batch_size, constraints=constraints)
        self._k = k
        self._proposer(1, 0)  # Refuses a wrong k at once.

    def _proposer(self, wanted: int, seed: int) -> Proposer:
        weights = [np.full(size, wanted) for size in self.space.sizes]
        return Proposer(self.constraints, self._k, weights=weights, combine="max", seed=seed)

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        categories, old, wanted = self.space.categorise(points), len(points), 1
        while len(categories) < old + self.batch_size:
            proposal = self._proposer(wanted, int(rng.integers(2**31))).propose(categories, old + self.batch_size - len(categories))
            if proposal is None:
                wanted += 1
            else:
                categories = np.vstack([categories, proposal.categories])
        return self.space.within(categories[old:], rng)
