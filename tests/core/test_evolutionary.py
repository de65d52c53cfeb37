"""Evolutionary testing, by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.core.samplers.evolutionary import EvolutionarySampler, _moved, impacts
from pipeline.core.space import Floats, Space, Variable
from tests.spaces import CONSTRAINED, SMALL

nan = np.nan


def sampler_after(
    kpi: Floats, space: Space = SMALL, **settings: Any
) -> tuple[EvolutionarySampler, Floats]:
    """A sampler after its first batch, which has these KPIs."""
    size = len(kpi)
    sampler = EvolutionarySampler(space, 0, batch_size=size, initial=size, **settings)
    points = sampler.ask()
    sampler.tell(points, kpi)
    return sampler, points


@pytest.mark.parametrize("space", [SMALL, CONSTRAINED], ids=["free", "constrained"])
def test_children_differ_from_the_lowest_tests_in_one_variable(space: Space) -> None:
    kpi = np.array([0.5, nan, 0.1, 0.9, -np.inf, 0.3, 0.8, 0.7])
    sampler, points = sampler_after(kpi, space, parents=2, explore=0.0)
    children = sampler.ask()
    parents = points[[2, 5]]  # The lowest finite ones; they take turns.
    assert ((children != parents[np.arange(8) % 2]).sum(axis=1) == 1).all()
    assert len(np.unique(np.concatenate([points, children]), axis=0)) == 16
    assert space.violation(children) is None


def test_among_equals_the_newest_are_parents() -> None:
    sampler, points = sampler_after(np.array([0.0, 0.5, 0.0, 0.0]), parents=2, explore=0.0)
    assert ((sampler.ask() != points[[3, 2, 3, 2]]).sum(axis=1) == 1).all()


def test_other_tests_join_the_parents() -> None:
    sampler, points = sampler_after(np.arange(12.0), parents=2, explore=1.0)
    children = sampler.ask()
    nearest = (children[:, None] != points[None]).sum(axis=2).argmin(axis=1)
    assert list(nearest[:2]) == [0, 1] and set(nearest[2:4]).isdisjoint({0, 1})
    assert np.array_equal(nearest, np.tile(nearest[:4], 3))


def test_no_parents_are_chosen_before_the_initial_tests() -> None:
    sampler = EvolutionarySampler(SMALL, 0, batch_size=6, initial=7, parents=1, explore=0.0)
    for near in (False, False, True):
        points = sampler.ask()
        assert (
            ((points != points[:1]).sum(axis=1) <= 2).all()
        ) == near  # Siblings differ in one or two variables.
        sampler.tell(points, np.arange(6.0))


def test_steps_stay_small_and_change_integers() -> None:
    space = Space(
        (
            Variable("angle", "continuous", "deg", 0, 360, 30, cyclic=True),
            Variable("count", "integer", "", 1, 100, 1),
        )
    )
    sampler, points = sampler_after(np.arange(40.0), space, parents=1, explore=0.0, step=0.01)
    moved = sampler.ask() - points[0]
    turned = (moved[:, 0] + 180) % 360 - 180
    assert 0 < np.abs(turned).max() < 5 * 3.6
    steps = moved[moved[:, 1] != 0, 1]
    assert (
        set(np.abs(steps)) >= {1.0}
        and np.abs(steps).max() <= 5
        and (steps == np.round(steps)).all()
    )


def test_impact_is_the_mean_deviation_among_tests_that_differ_in_one_variable() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [5.0, 7.0, 0.0]])
    # Tests 0 and 1 differ in the third variable alone, by 4; 0 and 2 in the second, by 1; none in
    # the first.
    assert impacts(points, np.array([1.0, 5.0, 2.0, 9.0])) == pytest.approx([1.25, 0.5, 2.0])
    assert impacts(points[[0, 3]], np.array([1.0, 5.0])) == pytest.approx([0.0, 0.0, 0.0])


def test_variables_with_more_impact_change_more_often() -> None:
    def changes(impact: float) -> Floats:
        sampler = EvolutionarySampler(
            SMALL, 0, batch_size=100, initial=100, parents=1, explore=0.0, impact=impact
        )
        for _ in range(2):
            points = sampler.ask()
            sampler.tell(points, points[:, 0])
        before = np.concatenate([sampler._points])
        parent = before[np.argmin(before[:, 0])]
        return np.asarray((sampler.ask() != parent).mean(axis=0))

    assert changes(1.0)[0] > 0.9 and changes(0.0)[0] < 0.5


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"initial": 0}, r"initial must be in \[1, 100000\], got 0"),
        ({"parents": 0}, r"parents must be in \[1, 1000\], got 0"),
        ({"explore": 1.5}, r"explore must be in \[0, 1\], got 1.5"),
        ({"impact": -1.0}, r"impact must be in \[0, 1\], got -1.0"),
        ({"step": 0.0}, r"step must be in \(0, 1\], got 0.0"),
    ],
)
def test_wrong_settings_are_named(settings: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        EvolutionarySampler(SMALL, 0, **settings)  # type: ignore[arg-type]


def test_an_integer_moves_by_at_least_one_however_small_the_step() -> None:
    lanes, steps = (
        Variable("lanes", "integer", "", 1, 100, 1),
        np.array([0.001, -0.001, 0.03, 0.02]),
    )
    assert _moved(lanes, np.array([50.0, 50, 50, 100]), steps, np.zeros(4)).tolist() == [
        51,
        49,
        53,
        100,
    ]
