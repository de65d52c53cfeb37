"""Every strategy passes the checker that ships."""

from __future__ import annotations

import pytest

from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.coverage import CoverageSampler
from pipeline.core.samplers.neural import NeuralSampler
from pipeline.core.samplers.pairwise import PairwiseSampler
from pipeline.core.samplers.random import RandomSampler
from pipeline.core.space import Floats, Space
from pipeline.protocols import Sampler
from pipeline.testing import check_sampler
from tests.spaces import SMALL, THESIS


@pytest.mark.parametrize("space", [SMALL, THESIS], ids=["small", "thesis"])
@pytest.mark.parametrize("make", [RandomSampler, NeuralSampler, PairwiseSampler, CoverageSampler])
def test_samplers_keep_the_contract(make: type[BatchSampler], space: Space) -> None:
    assert isinstance(make(space, 0), Sampler)
    check_sampler(lambda: make(space, 5), space)


class Forgetful(RandomSampler):
    """Draws anew whenever it is asked."""

    def ask(self) -> Floats:
        self.seed += 1
        self._batch = None
        return super().ask()


class Outside(RandomSampler):
    """Leaves the space."""

    def ask(self) -> Floats:
        return super().ask() + 1e6


@pytest.mark.parametrize(("make", "message"), [(Forgetful, "ask twice"), (Outside, "within the space")])
def test_the_checker_finds_broken_samplers(make: type[BatchSampler], message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_sampler(lambda: make(SMALL, 0), SMALL)
