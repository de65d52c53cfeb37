"""Half forest-guided, half random testing: the search whose frames a detector learns from."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from pipeline.core.samplers.forest import ForestSampler
from pipeline.core.samplers.untested import fill, untested
from pipeline.core.space import Floats


@dataclass(eq=False, repr=False, kw_only=True)
class MixedSampler(ForestSampler):
    """Fills a share of each batch with random tests; forest-guided testing fills the rest.

    The forest learns from both. A detector trained on failures alone forgets what it has learnt,
    because failures crowd in darkness, rain and fog. Random tests show it the rest of the space,
    like a defensive mixture in importance sampling (Owen and Zhou, 2000). The other parameters are
    those of `ForestSampler`.

    Args:
        uniform: share of random tests, in [0, 1]; they come first in each batch.
        attributes: whether the forest uses the attributes of categories, such as a person's
            height.

    Raises:
        ValueError: if a parameter is out of range.
    """

    uniform: float = 0.5
    attributes: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self.limit("[0, 1]", "uniform")

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
        settings = {field.name: getattr(self, field.name) for field in fields(ForestSampler)}
        settings["batch_size"] = self.batch_size - self._random
        if not self.attributes:
            plain = [replace(variable, attributes=()) for variable in self.space.variables]
            settings["space"] = replace(self.space, variables=tuple(plain))
        return ForestSampler(**settings)
