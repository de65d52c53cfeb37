"""Rules find planted failures and say them in the words of the domain."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from pipeline.core.descriptions import _bounds, _readable, _Values, likelihood_gain
from pipeline.core.rule_search import find_rule
from pipeline.core.rules import Condition, Rule
from pipeline.core.space import Space, Variable
from pipeline.core.words import Word, meanings
from pipeline.scenarios import people
from pipeline.scenarios.people import WORDS, person
from tests.planted import CHILDREN, FOG, PERSON, POSE, RAIN, SPACE, SPEED
from tests.spaces import CUT, SMALL


def found(rule: Rule, tests: int = 600, words: tuple[Word, ...] = WORDS) -> str:
    points = SPACE.sample(tests, np.random.default_rng(0))
    return find_rule(SPACE, points, rule.holds(points), words).rule.text(SPACE)


def test_the_gain_is_the_ratio_of_likelihoods() -> None:
    failed = np.arange(20) < 5
    by_hand = binom.logpmf(4, 6, 4 / 6) + binom.logpmf(1, 14, 1 / 14) - binom.logpmf(5, 20, 5 / 20)
    constant = np.log(
        [15.0, 14.0, 15504.0]
    )  # The binomial coefficients of 6 over 4, 14 over 1 and 20 over 5.
    assert float(likelihood_gain(np.array(4), np.array(6), failed)) == pytest.approx(
        by_hand - constant[0] - constant[1] + constant[2]
    )
    assert likelihood_gain(np.array([1, 0]), np.array([4, 3]), failed).tolist() == [
        -np.inf,
        -np.inf,
    ]


def test_a_word_is_preferred_to_an_attribute_and_an_attribute_to_names() -> None:
    children = Rule((Condition(PERSON, values=CHILDREN),))
    assert found(children) == "child"
    assert found(children, words=()) in ("height_m <= 1.4", "height_m <= 1.45", "height_m <= 1.5")
    assert (
        found(Rule((Condition(PERSON, values=(3, 40, 71)),))) == "blueprint in {W 04, M 04, M 35}"
    )


def test_words_describe_people_and_poses() -> None:
    values = {word.text: word.values for word in meanings(SPACE, WORDS)}
    names = SPACE.variables[PERSON].values
    assert {names[i] for i in values["child"]} == {name for name in names if person(name).child}
    assert set(values["child"]) | set(values["adult"]) == set(range(len(names)))
    assert {names[i] for i in values["under an umbrella"]} == {
        name for name in names if person(name).umbrella
    }
    assert values["stumbling"] == (SPACE.variables[POSE].values.index("stumble"),)
    assert len(values) == len(WORDS) and meanings(SMALL, WORDS) == ()


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
def test_integers_categories_and_cuts_have_rules_too(
    space: Space, condition: Condition, text: str
) -> None:
    points = space.sample(3000, np.random.default_rng(1))
    assert find_rule(space, points, condition.holds(points)).rule.text(space) == text


@pytest.mark.parametrize("population", [1, 2, 3])
def test_the_text_of_an_attribute_is_its_bound(population: int) -> None:
    """1.7000000000000002 is shown as 1.7, but a person of 1.7 m would not be in the rule."""
    blueprint = Space.from_dict({people.VARIABLE: people.variable(population)}).variables[0]
    for _, attribute in blueprint.attributes:
        numbers, bounds = np.array(attribute), _readable(np.array(attribute))
        assert [((numbers >= b) == (numbers >= float(f"{b:g}"))).all() for b in bounds] == [
            True
        ] * len(bounds)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_name_with_many_failures_pays_no_more_for_others_by_chance(seed: int) -> None:
    """Value 1 fails in 35 of 40 tests, 72 others in 15 % of a few tests; some fail always."""
    rng = np.random.default_rng(seed)
    values, failed = (
        np.concatenate([np.ones(40), rng.integers(2, 74, size=200)]),
        np.arange(240) < 35,
    )
    failed[40:] = rng.random(200) < 0.15
    offer = _Values(0, values, 74).best(np.ones(240, bool), failed)
    alone = float(likelihood_gain(np.array(35), np.array(40), failed)) - 2 * np.log(74)
    assert offer is not None and offer.gain >= alone - 1e-9 and offer.condition.values[0] == 1


def test_a_variable_of_one_value_says_nothing() -> None:
    space = Space((Variable("kind", "categorical", values=("only",)), SMALL.variables[0]))
    points = space.sample(200, np.random.default_rng(0))
    failed = points[:, 1] > space.variables[1].high / 2
    assert [
        condition.subject(space).name
        for condition in find_rule(space, points, failed).rule.conditions
    ] == [SMALL.names[0]]


def test_a_wide_integer_has_as_many_bounds_as_a_number() -> None:
    for high, step in ((5_000, 250), (100_000, 5_000)):
        whole, real = (
            _bounds(Variable("d", kind, "", 0, high, step=step))[0]
            for kind in ("integer", "continuous")
        )
        assert (whole == np.round(whole)).all() and len(whole) <= len(real) + 1
    assert len(_bounds(Variable("d", "integer", "", 0, 200, step=10))[0]) == 201


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
        [
            np.linspace(21, 29, 9),
            np.linspace(71, 79, 9),
            np.linspace(0, 19, 20),
            np.linspace(31, 69, 40),
            np.linspace(81, 100, 20),
        ]
    )
    failed = np.arange(len(fog)) < 18
    result = find_rule(space, fog[:, None], failed)
    assert failed[result.rule.holds(fog[:, None])].sum() == 9 and result.rule.text(space) in (
        "fog in [20, 30] %",
        "fog in [70, 80] %",
    )
