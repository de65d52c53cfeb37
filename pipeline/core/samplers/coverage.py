"""Coverage-guided testing: each batch covers the most new k-tuples of categories.

Source: Cheng et al., Definition 5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.space import Floats, Ints, Space

MOST_CELLS = 10_000_000
"""Combinations of categories that fit into memory."""


@dataclass(eq=False, repr=False, kw_only=True)
class CoverageSampler(BatchSampler):
    """Proposes categories that raise k-projection coverage most, and draws a value inside each.

    It ignores test results. Once every feasible k-tuple has been tested as often as its weight
    says, each is wanted as often again, and so on. A tuple's weight is the largest of its
    categories' weights, not their product as in the paper: two categories that are wanted three
    times each are wanted three times together, not nine.

    Args:
        space, seed, batch_size: as for `BatchSampler`.
        k: number of categories in a combination, in [1, 6]; a space with fewer variables combines
            all of them.

    Raises:
        ValueError: if k is out of range or too large for the space, or all weights are 0.

    >>> from pipeline.core.space import Space, Variable
    >>> space = Space(tuple(Variable(n, "categorical", values=("a", "b")) for n in "xy"))
    >>> sorted(CoverageSampler(space, seed=0, batch_size=4).ask().tolist())
    [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]
    """

    learns = False

    k: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        self.limit("[1, 6]", "k")
        # Combinations of k categories: the elementary symmetric polynomial of the sizes.
        cells = [1, *[0] * min(self.k, len(self.space))]
        for size in self.space.sizes:
            for order in range(len(cells) - 1, 0, -1):
                cells[order] += cells[order - 1] * size
        if cells[-1] > MOST_CELLS:
            raise ValueError(
                f"k must be smaller, as the space has {cells[-1]:,} combinations of {self.k}"
                f" categories, got {self.k}"
            )
        # The weight of a cell is the largest of its categories' weights, so a category with a
        # weight that some feasible point has is enough.
        for variable, weights in enumerate(self.space.weights):
            for category in np.flatnonzero(weights).tolist():
                if self.space.constraints.satisfiable({variable: category}):
                    return
        raise ValueError("coverage is undefined: the weights of all feasible cells sum to 0")

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        tested = self.space.categorise(points)
        categories = propose_categories(self.space, self.k, tested, self.batch_size, rng)
        return self.space.within(categories, rng)


def propose_categories(
    space: Space, k: int, tested: Ints, count: int, rng: np.random.Generator
) -> Ints:
    """Propose categories of further tests that raise k-projection coverage most.

    Args:
        space: the weights of its feasible cells must not all be 0.
        k: number of categories in a combination, at least 1, cut to the number of variables.
        tested: (n, d) categories of the tests so far.
        count: number of further tests.
        rng: source of all random draws.

    Returns:
        (count, d) categories.
    """
    # Both take long to import, and every study constructs every strategy to check it.
    from pipeline.core.coverage.projection import Demand
    from pipeline.core.coverage.proposals import Proposer

    categories, wanted = tested, 1
    while (missing := len(tested) + count - len(categories)) > 0:
        weights = [wanted * np.asarray(weights) for weights in space.weights]
        demand = Demand(space.constraints, min(k, len(space)), weights, "max")
        proposer = Proposer(demand, seed=int(rng.integers(2**31)))
        proposal = proposer.propose(categories, missing)
        if proposal is None:
            wanted += 1
        else:
            categories = np.vstack([categories, proposal.categories])
    return categories[len(tested) :]
