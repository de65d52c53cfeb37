"""Coverage-guided testing: each batch covers the most k-tuples of categories not yet covered (Cheng et al., Definition 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.coverage.projection import Demand
from pipeline.core.coverage.proposals import Proposer
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.space import Floats


@dataclass(eq=False, repr=False, kw_only=True)
class CoverageSampler(BatchSampler):
    """Proposes categories that raise k-projection coverage most, and draws a value inside each; ignores test results.

    Once every feasible k-tuple has been tested as often as its weight says, each is wanted that often once more, and so on.

    k: number of categories in a combination, at least 1; a space with fewer variables combines all of them.
    """

    k: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        nothing = np.zeros((0, len(self.space)), dtype=np.int64)
        if not self._proposer(1, 0).missing(nothing).any():
            raise ValueError("coverage is undefined: the weights of all feasible cells sum to 0")

    def _proposer(self, wanted: int, seed: int) -> Proposer:
        weights = [wanted * np.asarray(weights) for weights in self.space.weights]
        return Proposer(Demand(self.space.constraints, min(self.k, len(self.space)), weights, "max"), seed=seed)

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        categories, old, wanted = self.space.categorise(points), len(points), 1
        while len(categories) < old + self.batch_size:
            proposal = self._proposer(wanted, int(rng.integers(2**31))).propose(categories, old + self.batch_size - len(categories))
            if proposal is None:
                wanted += 1
            else:
                categories = np.vstack([categories, proposal.categories])
        return self.space.within(categories[old:], rng)
