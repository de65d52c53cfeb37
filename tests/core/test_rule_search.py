"""Rules find planted failures and say them in the words of the domain."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from pipeline.core.descriptions import likelihood_gain
from pipeline.core.rule_search import find_rule
from pipeline.core.rules import Condition, Rule
from pipeline.core.space import Space, Variable
from pipeline.core.words import Word, meanings
from pipeline.scenarios.people import WORDS, person
from tests.planted import CHILDREN, FOG, PERSON, POSE, RAIN, SPACE, SPEED
from tests.spaces import CUT, SMALL


def found(rule: Rule, tests: int = 600, words: tuple[Word, ...] = WORDS) -> str:
    points = SPACE.sample(tests, np.random.default_rng(0))
    return find_rule(SPACE, points, rule.holds(points), words).rule.text(SPACE)


def test_the_gain_is_the_ratio_of_likelihoods() -> None:
    failed = np.arange(20) < 5
    by_hand = binom.logpmf(4, 6, 4 / 6) + binom.logpmf(1, 14, 1 / 14) - binom.logpmf(5, 20, 5 / 20)
    constant = np.log([15.0, 14.0, 15504.0])  # The binomial coefficients of 6 over 4, 14 over 1 and 20 over 5.
    assert float(likelihood_gain(np.array(4), np.array(6), failed)) == pytest.approx(by_hand - constant[0] - constant[1] + constant[2])
    assert likelihood_gain(np.array([1, 0]), np.array([4, 3]), failed).tolist() == [-np.inf, -np.inf]


def test_a_word_is_preferred_to_an_attribute_and_an_attribute_to_names() -> None:
    children = Rule((Condition(PERSON, values=CHILDREN),))
    assert found(children) == "child"
    assert found(children, words=()) in ("height_m <= 1.4", "height_m <= 1.45", "height_m <= 1.5")
    assert found(Rule((Condition(PERSON, values=(3, 40, 71)),))) == "blueprint in {W 04, M 04, M 35}"


def test_words_describe_people_and_poses() -> None:
    known = {word.text: word.values for word in meanings(SPACE, WORDS)}
    names = SPACE.variables[PERSON].values
    assert {names[i] for i in known["child"]} == {name for name in names if person(name).child}
    assert set(known["child"]) | set(known["adult"]) == set(range(len(names)))
    assert {names[i] for i in known["under an umbrella"]} == {name for name in names if person(name).umbrella}
    assert known["stumbling"] == (SPACE.variables[POSE].values.index("stumble"),)
    assert len(known) == len(WORDS) and meanings(SMALL, WORDS) == ()


def test_bounds_are_round_unless_the_tests_tell_better() -> None:
    assert found(Rule((Condition(RAIN, 40, 100),))) == "rain >= 40 %"
    precise = Rule((Condition(FOG, 43, 100),))
    assert found(precise, tests=4000) in ("fog >= 43 %", "fog >= 42 %")
    assert found(Rule((Condition(SPEED, 1, 2),)), tests=2000) == "pedestrian_speed in [1, 2] m/s"


@pytest.mark.parametrize(
    ("space", "condition", "text"),
    [
        (SMALL, Condition(2, 2, 3), "count in [2, 3]"),
        (SMALL, Condition(3, values=(1,)), "kind = b"),
        (CUT, Condition(0, 20, 50), "fog in [20, 50] %"),
    ],
)
def test_integers_categories_and_cuts_have_rules_too(space, condition, text) -> None:  # type: ignore[no-untyped-def]
    points = space.sample(3000, np.random.default_rng(1))
    assert find_rule(space, points, condition.holds(points)).rule.text(space) == text


def test_no_rule_is_a_single_number_of_a_continuous_variable() -> None:
    points = SPACE.sample(400, np.random.default_rng(2))
    points[:60, FOG] = 100
    points[60:, FOG] *= 0.9
    rule = find_rule(SPACE, points, np.arange(400) < 60, WORDS).rule
    assert [condition.subject(SPACE).name for condition in rule.conditions] == ["fog"]
    assert rule.conditions[0].low < rule.conditions[0].high == 100


def test_no_rule_pays_for_labels_at_random_or_without_two_outcomes() -> None:
    rng = np.random.default_rng(0)
    points = SPACE.sample(60, rng)
    for failed in (rng.random(60) < 0.2, np.ones(60, bool), np.zeros(60, bool)):
        assert find_rule(SPACE, points, failed, WORDS).rule == Rule(())


def test_of_equally_good_intervals_one_of_them_is_chosen() -> None:
    space = Space((Variable("fog", "continuous", "%", 0, 100, 10),))
    fog = np.concatenate(
        [np.linspace(21, 29, 9), np.linspace(71, 79, 9), np.linspace(0, 19, 20), np.linspace(31, 69, 40), np.linspace(81, 100, 20)]
    )
    failed = np.arange(len(fog)) < 18
    found = find_rule(space, fog[:, None], failed)
    assert failed[found.rule.holds(fog[:, None])].sum() == 9 and found.rule.text(space) in ("fog in [20, 30] %", "fog in [70, 80] %")
