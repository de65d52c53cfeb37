"""Half forest-guided, half random testing: the search whose frames a detector learns from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.forest import ForestSampler
from pipeline.core.samplers.untested import fill, untested
from pipeline.core.space import Floats


@dataclass(eq=False, repr=False, kw_only=True)
class MixedSampler(BatchSampler):
    """Fills a share of each batch with random tests; forest-guided testing fills the rest.

    The forest learns from both. A detector trained on failures alone forgets what it has learnt,
    because failures crowd in darkness, rain and fog. Random tests show it the rest of the space,
    like a defensive mixture in importance sampling (Owen and Zhou, 2000).

    Args:
        space, seed, batch_size: as for `BatchSampler`.
        uniform: share of random tests, in [0, 1]; they come first in each batch.
        attributes: whether the forest uses the attributes of categories, such as a person's
            height.
        failure_threshold_s: as for `ForestSampler`.
        earlier: as for `ForestSampler`.

    Raises:
        ValueError: if a parameter is out of range.
    """

    uniform: float = 0.5
    attributes: bool = True
    failure_threshold_s: float = 0.1
    earlier: Sequence[tuple[Floats, Floats]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        self.limit("[0, 1]", "uniform")
        self.limit("(0, 10]", "failure_threshold_s")

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        drawn = fill(self.space, points[:0], points, self._random, rng)
        if self._random == self.batch_size:
            return drawn
        guided = self._guide._choose(index, points, kpi, rng)
        chosen = np.concatenate([drawn, guided[untested(guided, drawn)]])
        return fill(self.space, chosen, points, self.batch_size, rng)

    @property
    def _random(self) -> int:
        return round(self.uniform * self.batch_size)

    @cached_property
    def _guide(self) -> ForestSampler:
        space = self.space
        if not self.attributes:
            plain = [replace(variable, attributes=()) for variable in space.variables]
            space = replace(space, variables=tuple(plain))
        # Settings with which the published versions searched. Whether the forest's newer defaults
        # teach more was not measured.
        return ForestSampler(
            space,
            self.seed,
            batch_size=self.batch_size - self._random,
            candidates=3000,
            mutants=0.75,
            refinements=0,
            kinds=0.1,
            explore=0.1,
            explore_until=1,
            exploitation=0,
            trees=60,
            failure_threshold_s=self.failure_threshold_s,
            earlier=self.earlier,
        )
