"""Fresh tests inside and just outside a rule, and what they say of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, fisher_exact

from pipeline.core.confirmation import (
    MARGIN,
    NarrowError,
    confirmed,
    draw_inside,
    draw_just_outside,
    more_inside,
)
from pipeline.core.counted import Counted
from pipeline.core.grouping import Outcomes, group_failures
from pipeline.core.rules import Condition, Rule
from pipeline.core.space import Space, Variable
from pipeline.scenarios.people import WORDS
from tests.planted import CHILDREN, CROUCHING, FOG, PERSON, POSE, RAIN, SPACE, UMBRELLAS, WORLDS
from tests.spaces import CONSTRAINED, SMALL

RULE = Rule((Condition(RAIN, 40, 60), Condition(PERSON, values=CHILDREN)))


def test_points_inside_are_uniform() -> None:
    points = draw_inside(SPACE, RULE, 4000, np.random.default_rng(0))
    assert points.shape == (4000, len(SPACE)) and RULE.holds(points).all()
    assert points[:, RAIN].mean() == pytest.approx(50, abs=0.5) and points[
        :, RAIN
    ].std() == pytest.approx(20 / np.sqrt(12), abs=0.2)
    assert np.bincount(points[:, PERSON].astype(int))[list(CHILDREN)] == pytest.approx(500, abs=100)
    assert (
        draw_inside(SPACE, RULE, 50, np.random.default_rng(1))
        == draw_inside(SPACE, RULE, 50, np.random.default_rng(1))
    ).all()


def test_points_just_outside_break_one_condition_by_little() -> None:
    points = draw_just_outside(SPACE, RULE, 2000, np.random.default_rng(0))
    rain, child = points[:, RAIN], np.isin(points[:, PERSON], CHILDREN)
    inside = (rain >= 40) & (rain <= 60)
    assert (inside ^ child).all() and inside.mean() == pytest.approx(0.5, abs=0.05)
    assert rain.min() >= 40 - 100 * MARGIN and rain.max() <= 60 + 100 * MARGIN


def test_a_difference_is_drawn_inside_and_just_outside_too() -> None:
    rule, rng = (
        Rule((Condition(RAIN, -10, 10, other=FOG, sign=-1), Condition(RAIN, 40, 100))),
        np.random.default_rng(0),
    )
    inside = draw_inside(SPACE, rule, 500, rng)
    assert (np.abs(inside[:, RAIN] - inside[:, FOG]) <= 10).all() and (inside[:, RAIN] >= 40).all()
    points = draw_just_outside(SPACE, rule, 500, rng)
    gap = np.abs(points[:, RAIN] - points[:, FOG])
    assert (
        ((gap <= 10) ^ (points[:, RAIN] >= 40)).all()
        and gap.max() <= 10 + 200 * MARGIN
        and (gap > 10).any()
    )


def test_an_arc_has_an_outside_on_both_ends_of_the_range() -> None:
    points = draw_just_outside(SMALL, Rule((Condition(1, 350, 20),)), 500, np.random.default_rng(0))
    angles = points[:, 1]
    assert (
        (((angles > 20) & (angles <= 56)) | ((angles >= 314) & (angles < 350))).all()
        and (angles > 300).any()
        and (angles < 60).any()
    )


def test_infeasible_points_are_not_drawn() -> None:
    rule = Rule((Condition(3, values=(0,)),))
    points = draw_inside(CONSTRAINED, rule, 100, np.random.default_rng(0))
    assert (points[:, 2] == 1).all() and CONSTRAINED.violation(points) is None
    with pytest.raises(
        NarrowError, match="the constraints exclude almost all that the rule admits"
    ):
        draw_inside(
            CONSTRAINED,
            Rule((Condition(3, values=(0,)), Condition(2, 2, 5))),
            5,
            np.random.default_rng(0),
        )
    assert draw_just_outside(SMALL, Rule(()), 5, np.random.default_rng(0)).shape == (0, 4)


def test_an_error_other_than_a_narrow_rule_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise ValueError("operands could not be broadcast together")

    monkeypatch.setattr(Variable, "scale", refuse)
    with pytest.raises(ValueError, match="broadcast"):
        draw_just_outside(SMALL, Rule((Condition(1, 10, 20),)), 5, np.random.default_rng(0))


def test_conditions_on_the_same_variable_are_broken_one_at_a_time() -> None:
    rule = Rule(
        (
            Condition(POSE, values=CROUCHING),
            Condition(PERSON, values=UMBRELLAS),
            Condition(PERSON, values=UMBRELLAS[:2]),
        )
    )
    points = draw_just_outside(SPACE, rule, 300, np.random.default_rng(0))
    held = np.array([condition.holds(points) for condition in rule.conditions])
    # Nobody is one of the two without having an umbrella: that condition cannot be broken alone.
    assert (held.sum(axis=0) == 2).all() and held[1].all()


def test_the_exact_interval_has_its_tails() -> None:
    low, high = Counted(20, 7).interval(0.95)
    assert binom.sf(6, 20, low) == pytest.approx(0.025) and binom.cdf(7, 20, high) == pytest.approx(
        0.025
    )
    assert (
        Counted(20, 0).interval(0.95)[0] == 0
        and Counted(20, 20).interval(0.95)[1] == 1
        and Counted(0, 0).interval(0.95) == (0, 1)
    )
    assert Counted.of(np.array([True, True, False]), np.array([True, False, False])) == Counted(
        tests=2, failures=1, errors=1
    )
    with pytest.raises(ValueError, match=r"failures must be in \[0, 3\]"):
        Counted(3, 4)


def test_rules_are_confirmed_together() -> None:
    inside, outside = Counted(20, 15), Counted(20, 5)
    assert more_inside(inside, outside) == pytest.approx(
        fisher_exact([[15, 5], [5, 15]], alternative="greater")[1]
    )
    assert confirmed(
        [(inside, outside), (outside, inside), (Counted(0, 0), Counted(0, 0))], 0.05
    ) == [True, False, False]
    # 4 of 4 against 0 of 4: one in 70. Alone it is enough, beside three other rules it is not.
    few = (Counted(4, 4), Counted(4, 0))
    assert confirmed([few], 0.05) == [True] and confirmed([], 0.05) == []
    assert confirmed([few, *[(outside, outside)] * 3], 0.05) == [False] * 4


@pytest.mark.parametrize("name", ["two boxes", "two words"])
def test_planted_regions_are_confirmed(name: str) -> None:
    world, rng = WORLDS[name], np.random.default_rng(1)
    tests = world.outcomes(0)
    counts = []
    for group in group_failures(tests, np.where(tests.failed, "box", "none"), 0.5, 4):
        drawn = (
            draw_inside(SPACE, group.rule, 20, rng),
            draw_just_outside(SPACE, group.rule, 20, rng),
        )
        counts.append((Counted.of(world.fails(drawn[0])), Counted.of(world.fails(drawn[1]))))
    assert counts and confirmed(counts, 0.05) == [True] * len(counts)


def test_labels_at_random_are_hardly_ever_confirmed() -> None:
    """Every rule that a search of noise would propose, at a rate of 30 %.

    At most 5 % are confirmed; of 20, four have a chance of 2 %.
    """
    false, rule = 0, Rule((Condition(RAIN, 40, 60), Condition(POSE, values=CROUCHING)))
    for seed in range(20):
        rng = np.random.default_rng(seed)
        drawn = draw_inside(SPACE, rule, 20, rng), draw_just_outside(SPACE, rule, 20, rng)
        inside, outside = (Counted.of(rng.random(len(points)) < 0.3) for points in drawn)
        false += confirmed([(inside, outside)], 0.05)[0]
    assert false <= 3


def test_words_do_not_change_what_a_rule_admits() -> None:
    tests = WORLDS["an attribute"].outcomes(1)
    (group,) = group_failures(
        Outcomes(SPACE, tests.points, tests.failed, WORDS),
        np.where(tests.failed, "box", "none"),
        0.5,
        4,
    )
    assert group.rule.holds(draw_inside(SPACE, group.rule, 100, np.random.default_rng(0))).all()


def test_a_rule_without_a_fresh_test_is_not_confirmed() -> None:
    only_errors = Counted(0, 0, 40)
    assert (
        more_inside(only_errors, Counted(20, 0)) == more_inside(Counted(20, 20), only_errors) == 1
    )
    assert confirmed([(only_errors, only_errors)], 0.05) == [False]


def test_just_outside_a_bound_of_an_integer_is_the_next_one() -> None:
    space = Space(
        (
            Variable("lanes", "integer", low=1, high=4, step=1),
            Variable("rain", "continuous", low=0, high=100, step=10),
        )
    )
    points = draw_just_outside(space, Rule((Condition(0, 1, 2),)), 50, np.random.default_rng(0))
    assert (points[:, 0] == 3).all() and len(points) == 50


def test_each_rule_that_is_confirmed_makes_it_easier_for_the_next() -> None:
    # One in 70 and one in 20: of two rules the first needs half of alpha, the second all of it.
    first, second = (Counted(4, 4), Counted(4, 0)), (Counted(3, 3), Counted(3, 0))
    assert confirmed([second, first], 0.0501) == [True, True]
    assert confirmed([second, first], 0.0499) == [False, True] and confirmed(
        [first, first], 0.028
    ) == [False, False]


def test_just_outside_an_arc_reaches_across_the_ends_of_the_range() -> None:
    angles = draw_just_outside(
        SMALL, Rule((Condition(1, 330, 355),)), 500, np.random.default_rng(0)
    )[:, 1]
    assert (((angles >= 294) & (angles < 330)) | (angles > 355) | (angles <= 31)).all() and (
        angles <= 31
    ).any()
