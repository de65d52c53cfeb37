"""Every strategy passes the shipped checker."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.random import RandomSampler
from pipeline.core.space import Floats, Space
from pipeline.protocols import Sampler
from pipeline.testing import check_sampler
from tests.spaces import CONSTRAINED, SMALL, THESIS
from tests.strategies import Strategy, strategies


@pytest.mark.parametrize(
    "space", [SMALL, THESIS, CONSTRAINED], ids=["small", "thesis", "constrained"]
)
@pytest.mark.parametrize("make", strategies().values(), ids=strategies().keys())
def test_samplers_keep_the_contract(make: Strategy, space: Space) -> None:
    assert isinstance(make(space, 0), Sampler)
    check_sampler(lambda: make(space, 5), space)


class Planned(RandomSampler):
    """Ends after two batches."""

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        return self.space.sample(self.batch_size if index < 2 else 0, rng)


class Silent(RandomSampler):
    """Never has a point."""

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        return self.space.sample(0, rng)


def test_a_sampler_may_end_the_campaign() -> None:
    check_sampler(lambda: Planned(SMALL, 0), SMALL)


class Forgetful(RandomSampler):
    """Draws new points on every ask."""

    def ask(self) -> Floats:
        self.seed += 1
        self._batch = None
        return super().ask()


class Outside(RandomSampler):
    """Leaves the space."""

    def ask(self) -> Floats:
        return super().ask() + 1e6


class Heedless(RandomSampler):
    """Ignores constraints."""

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        return self.space.scale(rng.random((self.batch_size, len(self.space))))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (Forgetful, "ask twice"),
        (Outside, "within the space"),
        (Heedless, "ask must keep the constraints"),
        (Silent, "at least one point"),
    ],
)
def test_the_checker_finds_faulty_samplers(make: type[BatchSampler], message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_sampler(lambda: make(CONSTRAINED, 0), CONSTRAINED)
