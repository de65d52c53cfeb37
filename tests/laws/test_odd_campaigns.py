"""Every strategy copes with odd spaces, odd results and errors.

Also with spaces that are smaller than the budget.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.random import RandomSampler
from pipeline.core.space import Floats, Space, Variable
from tests.spaces import CONSTRAINED, SMALL
from tests.strategies import Strategy, strategies

pytestmark = [pytest.mark.usefixtures("short_annealing"), pytest.mark.filterwarnings("error")]

BATCH, BATCHES = 8, 3
"""Enough for every strategy to learn.

Meta-models choose hyperparameters from 8 tests; evolutionary testing mutates from 20.
"""
X = Variable("x", "continuous", "m", 0, 10, 1)
KIND = Variable("kind", "categorical", values=("a", "b", "c"))
SIDE = Variable("side", "categorical", values=("left", "right"))
COUNT = Variable("count", "integer", "", 1, 5, 1)
SPACES = {
    "mixed": SMALL,
    "constrained": CONSTRAINED,
    "categorical": Space((KIND, SIDE)),
    "continuous": Space((X, Variable("angle", "continuous", "deg", 0, 360, 30, cyclic=True))),
    "one continuous": Space((X,)),
    "one integer": Space((COUNT,)),
    "one category": Space((KIND,)),
    "one value": Space((X, Variable("town", "categorical", values=("Here",)))),
    "nothing to change": Space((Variable("town", "categorical", values=("Here",)),)),
    "equal attributes": Space(
        (
            X,
            Variable(
                "side",
                "categorical",
                values=("left", "right"),
                attributes=(("width_m", (1.0, 1.0)),),
            ),
        )
    ),
}
KPIS: dict[str, Callable[[Floats], Floats]] = {
    "all fail": lambda points: np.zeros(len(points)),
    "none fails": lambda points: 1 + points[:, 0],
    "all equal": lambda points: np.ones(len(points)),
    "all errors": lambda points: np.full(len(points), np.nan),
    "infinite": lambda points: np.where(
        points[:, 0] > 1, np.inf, np.where(np.arange(len(points)) % 2, -np.inf, 1.0)
    ),
    "negative": lambda points: -1 - points[:, 0],
    "huge": lambda points: np.where(
        np.arange(len(points)) % 4 == 1, 1e12 * (1 + points[:, 0]), points[:, 0]
    ),
    "some fail": lambda points: np.where(np.arange(len(points)) % 5 == 2, np.nan, points[:, 0] - 1),
}
INDIFFERENT = {"random", "pairwise", "coverage"}
"""Strategies that ignore results, and so may execute a test again while others are untested."""


def chosen(names: set[str]) -> pytest.MarkDecorator:
    """Every strategy but these."""
    found = {name: make for name, make in strategies().items() if name not in names}
    return pytest.mark.parametrize("make", found.values(), ids=found.keys())


def run(
    sampler: BatchSampler, kpi: Callable[[Floats], Floats], batches: int
) -> tuple[Floats, Floats]:
    told = []
    for _ in range(batches):
        asked = sampler.ask()
        sampler.tell(asked, kpi(asked))
        told.append((asked, kpi(asked)))
    points, values = (np.concatenate(parts) for parts in zip(*told, strict=True))
    return points, values


@chosen(set())
@pytest.mark.parametrize("space", SPACES.values(), ids=SPACES.keys())
def test_any_results_on_any_space_give_valid_tests_and_an_exact_replay(
    make: Strategy, space: Space
) -> None:
    for kpi in KPIS.values():
        sampler, replayed = make(space, 3, batch_size=BATCH), make(space, 3, batch_size=BATCH)
        points, values = run(sampler, kpi, BATCHES)
        for start in range(0, len(points), 5):
            replayed.tell(points[start : start + 5], values[start : start + 5])
        asked = sampler.ask()
        assert asked.shape == (BATCH, len(space)) and np.array_equal(asked, replayed.ask())
        for point in np.concatenate([points, asked]):
            assert np.array_equal(
                space.encode(space.decode(point)), point
            )  # `encode` rejects what is outside or breaks a constraint.


@chosen(INDIFFERENT)
def test_a_small_space_is_tested_completely_and_then_again(make: Strategy) -> None:
    space = Space((KIND, SIDE), (("kind != c", "side = left"),))
    points, _ = run(make(space, 0, batch_size=4), KPIS["some fail"], 5)
    assert len(np.unique(points[:5], axis=0)) == 5
    assert len(points) == 20


@chosen(INDIFFERENT)
def test_every_test_is_new_while_the_space_has_new_ones(make: Strategy) -> None:
    space = Space((KIND, SIDE, COUNT, Variable("lanes", "integer", "", 1, 4, 1)))
    points, _ = run(make(space, 1, batch_size=20), KPIS["some fail"], 6)
    assert len(np.unique(points, axis=0)) == len(points) == 3 * 2 * 5 * 4


@chosen(INDIFFERENT)
def test_errors_do_not_mislead(make: Strategy) -> None:
    """A fifth of the space, far from the failures, gives errors."""

    def kpi(points: Floats) -> Floats:
        return np.where(points[:, 0] < 2, np.nan, 1.05 - points[:, 0] / 10)

    def failures(sampler: BatchSampler) -> int:
        return int(np.sum(run(sampler, kpi, 8)[1] <= 0.1))

    found, drawn = (
        sum(failures(kind(SMALL, seed, batch_size=10)) for seed in range(2))
        for kind in (make, RandomSampler)
    )
    assert found >= 2 * drawn > 0
