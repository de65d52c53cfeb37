"""Coverage-guided testing: each batch covers the most k-tuples of categories not yet covered (Cheng et al., Definition 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.space import Floats, Ints, Space

if TYPE_CHECKING:
    from pipeline.core.coverage.proposals import Proposer

MOST_CELLS = 10_000_000
"""Combinations of categories that fit into memory."""


@dataclass(eq=False, repr=False, kw_only=True)
class CoverageSampler(BatchSampler):
    """Proposes categories that raise k-projection coverage most, and draws a value inside each; ignores test results.

    Once every feasible k-tuple has been tested as often as its weight says, each is wanted as often again, and so on. A tuple's weight is
    the largest of its categories' weights, not their product as in the paper: two categories that are wanted three times each are wanted
    three times together, not nine.

    k: number of categories in a combination, 1 to 6; a space with fewer variables combines all of them.
    """

    learns = False

    k: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        self.limit("[1, 6]", "k")
        if (cells := _cells(self.space, self.k)) > MOST_CELLS:
            raise ValueError(
                f"k must be smaller, as the space has {cells:,} combinations of {self.k} categories, got {self.k}"
            )
        if not _wanted(self.space):
            raise ValueError("coverage is undefined: the weights of all feasible cells sum to 0")

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        return self.space.within(
            propose_categories(
                self.space, self.k, self.space.categorise(points), self.batch_size, rng
            ),
            rng,
        )


def propose_categories(
    space: Space, k: int, tested: Ints, count: int, rng: np.random.Generator
) -> Ints:
    """Categories of `count` further tests that raise k-projection coverage most, (count, d), given those of the tests so far, (n, d).

    k: cut to the number of variables. The weights of the space's feasible cells must not all be 0.
    """
    categories, wanted = tested, 1
    while (missing := len(tested) + count - len(categories)) > 0:
        proposal = _proposer(space, k, wanted, int(rng.integers(2**31))).propose(
            categories, missing
        )
        if proposal is None:
            wanted += 1
        else:
            categories = np.vstack([categories, proposal.categories])
    return categories[len(tested) :]


def _cells(space: Space, k: int) -> int:
    """Number of combinations of `k` categories, feasible or not: the elementary symmetric polynomial of the sizes."""
    found = [1, *[0] * min(k, len(space))]
    for size in space.sizes:
        for order in range(len(found) - 1, 0, -1):
            found[order] += found[order - 1] * size
    return found[-1]


def _wanted(space: Space) -> bool:
    """Whether any feasible cell has a weight: the largest of its categories' weights, so a category that a feasible point has is enough."""
    categories = (
        (variable, category)
        for variable, weights in enumerate(space.weights)
        for category in np.flatnonzero(weights)
    )
    return any(
        space.constraints.satisfiable({variable: int(category)})
        for variable, category in categories
    )


def _proposer(space: Space, k: int, wanted: int, seed: int) -> Proposer:
    from pipeline.core.coverage.projection import (
        Demand,
    )  # Both compile, and every study makes every strategy to check it.
    from pipeline.core.coverage.proposals import Proposer

    weights = [wanted * np.asarray(weights) for weights in space.weights]
    return Proposer(Demand(space.constraints, min(k, len(space)), weights, "max"), seed=seed)
