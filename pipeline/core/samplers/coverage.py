"""Coverage-guided testing: each batch covers the most k-tuples of categories not yet covered (Cheng et al., Definition 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.coverage.projection import Demand
from pipeline.core.coverage.proposals import Proposer
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.space import Floats, Ints, Space


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
        if not _proposer(self.space, self.k, 1, 0).missing(nothing).any():
            raise ValueError("coverage is undefined: the weights of all feasible cells sum to 0")

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        return self.space.within(propose_categories(self.space, self.k, self.space.categorise(points), self.batch_size, rng), rng)


def propose_categories(space: Space, k: int, tested: Ints, count: int, rng: np.random.Generator) -> Ints:
    """Categories of `count` further tests that raise k-projection coverage most, (count, d), given those of the tests so far, (n, d).

    k: cut to the number of variables. The weights of the space's feasible cells must not all be 0.
    """
    categories, wanted = tested, 1
    while (missing := len(tested) + count - len(categories)) > 0:
        proposal = _proposer(space, k, wanted, int(rng.integers(2**31))).propose(categories, missing)
        if proposal is None:
            wanted += 1
        else:
            categories = np.vstack([categories, proposal.categories])
    return categories[len(tested) :]


def _proposer(space: Space, k: int, wanted: int, seed: int) -> Proposer:
    weights = [wanted * np.asarray(weights) for weights in space.weights]
    return Proposer(Demand(space.constraints, min(k, len(space)), weights, "max"), seed=seed)
