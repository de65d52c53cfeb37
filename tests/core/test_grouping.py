"""Failure regions of planted worlds: found, named, and none where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.density import dense_groups, described_distance, described_radius
from pipeline.core.distance import mixed_distance
from pipeline.core.grouping import MIXED, Group, Outcomes, group_failures, held_back
from pipeline.core.rules import Condition, Rule
from pipeline.core.space import Space, Variable
from pipeline.scenarios.people import WORDS
from tests.planted import ALTITUDE, CHILDREN, FOG, PERSON, RAIN, SPACE, WORLDS, overlap
from tests.spaces import SMALL, THESIS

NEIGHBOURS, MIN_FAILURES = 0.5, 4


def groups_of(tests: Outcomes, causes: np.ndarray | None = None) -> list[Group]:
    return group_failures(
        tests,
        np.where(tests.failed, "box", "none") if causes is None else causes,
        NEIGHBOURS,
        MIN_FAILURES,
    )


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("seed", range(2))
def test_planted_regions_are_found_and_overlap_the_truth(name: str, seed: int) -> None:
    world = WORLDS[name]
    groups = groups_of(world.outcomes(seed))
    assert len(groups) == len(world.boxes)
    for box in world.boxes:
        assert max(overlap(SPACE, group.rule, box) for group in groups) >= 0.7
    texts = [group.rule.text(SPACE) for group in groups]
    for begin in world.texts:
        assert any(text.startswith(begin) for text in texts), texts


def test_labels_at_random_make_hardly_any_region() -> None:
    """The rate is e^-3, 5 %; of ten worlds, more than two false ones have a chance below 2 %."""
    false = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        points = SPACE.sample(200, rng)
        false += bool(groups_of(Outcomes(SPACE, points, rng.random(200) < 0.15, WORDS)))
    assert false <= 2


def test_each_cause_has_regions_of_its_own_and_what_is_left_is_grouped_together() -> None:
    points = SPACE.sample(800, np.random.default_rng(0))
    night, children = points[:, ALTITUDE] <= 0, np.isin(points[:, PERSON], CHILDREN)
    rain = (points[:, RAIN] > 90) & ~night & ~children
    few = np.array(["box", "confidence", "too_late"])[np.arange(800) // 3 % 3]
    causes = np.select([night, children, rain], ["never_seen", "box", few], "none")
    isolated = np.flatnonzero(~(night | children | rain))[[5, 200]]
    causes[isolated] = "false_positives"
    groups = groups_of(Outcomes(SPACE, points, causes != "none", WORDS), causes)
    texts = {(group.cause, group.rule.text(SPACE)) for group in groups}
    assert {("never_seen", "sun_altitude <= 0 deg"), ("box", "child")} <= texts
    assert all(
        set(causes[group.members]) == {group.cause} for group in groups if group.cause != MIXED
    )
    assert not any(group.members[isolated].any() for group in groups)
    assert np.sum([group.members for group in groups], axis=0).max() == 1, (
        "a failure is in one region"
    )


def test_too_few_failures_of_each_cause_are_one_region_of_several() -> None:
    points = SPACE.sample(300, np.random.default_rng(1))
    failed = (points[:, FOG] > 90) & (np.cumsum(points[:, FOG] > 90) <= 15)
    points[(points[:, FOG] > 90) & ~failed, FOG] = 50
    causes = np.where(
        failed,
        np.array(["box", "confidence", "too_late", "never_seen", "false_positives"])[
            np.cumsum(failed) % 5
        ],
        "none",
    )
    (group,) = groups_of(Outcomes(SPACE, points, failed, WORDS), causes)
    assert (
        group.cause == MIXED
        and group.rule.text(SPACE).startswith("fog >= 9")
        and group.members.sum() == 15
    )


def test_if_nearly_every_test_fails_all_failures_are_one_region() -> None:
    points = SPACE.sample(100, np.random.default_rng(0))
    (group,) = groups_of(Outcomes(SPACE, points, np.arange(100) > 2, WORDS))
    assert (group.cause, group.rule, int(group.members.sum())) == (MIXED, Rule(()), 97)
    assert held_back(Outcomes(SPACE, points, np.arange(100) > 2), group) == (100, 97)
    assert groups_of(Outcomes(SPACE, points[:3], np.ones(3, bool))) == []


def test_held_back_tests_are_judged_by_rules_that_have_not_seen_them() -> None:
    tests = WORLDS["two words"].outcomes(0)
    (group,) = groups_of(tests)
    assert held_back(tests, group) == (int(group.members.sum()), int(group.members.sum()))
    # The only failures of a block: the rule of the others knows nothing of them.
    failed = np.arange(400) < 20
    points = np.where(failed[:, None], SPACE.sample(1, np.random.default_rng(0)), tests.points)
    alone = Outcomes(SPACE, points, failed, WORDS)
    (group,) = groups_of(alone)
    assert group.rule.holds(points[:20]).all() and held_back(alone, group)[1] == 0


def test_values_with_similar_attributes_are_near_each_other() -> None:
    people = Variable(
        "person",
        "categorical",
        values=("a", "b", "c"),
        attributes=(("height_m", (1.0, 1.1, 1.4)), ("hat", (0, 0, 1))),
    )
    space = Space((people, SMALL.variables[0]))
    points = np.array([[0.0, 2], [1, 2], [2, 2], [0, 7]])
    by_hand = [[0, (0.25 + 0) / 4, (1 + 1) / 4, 0.25], [0.0625, 0, (0.75 + 1) / 4, 0.0625 + 0.25]]
    assert described_distance(space, points[:2], points) == pytest.approx(np.array(by_hand))
    bare = THESIS.sample(5, np.random.default_rng(0))
    assert (described_distance(THESIS, bare, bare) == mixed_distance(THESIS, bare, bare)).all(), (
        "without attributes"
    )


def test_the_radius_contains_the_expected_failures_by_chance() -> None:
    radius = described_radius(SPACE, 200, 2.0)
    points = SPACE.sample(200, np.random.default_rng(5))
    assert (
        1.4 < ((described_distance(SPACE, points, points) <= radius).sum(axis=1) - 1).mean() < 2.8
    )
    assert described_radius(SPACE, 400, 2.0) < radius < described_radius(SPACE, 200, 4.0)
    assert described_radius(SPACE, 1, 2.0) == 1
    with pytest.raises(ValueError, match="neighbours must be positive, got 0"):
        described_radius(SPACE, 200, 0)


def test_dense_groups_come_larger_first_with_noise_apart() -> None:
    near, far, alone = [[1.0, 0, 1, 0]] * 3, [[9.0, 180, 5, 2]] * 4, [[5.0, 90, 3, 1]]
    assert dense_groups(SMALL, np.array(near + far + alone), 0.0, 3).tolist() == [
        1,
        1,
        1,
        0,
        0,
        0,
        0,
        -1,
    ]
    assert dense_groups(SMALL, np.zeros((0, 4)), 0.1, 3).tolist() == []


def test_a_space_of_few_categories_has_regions_too() -> None:
    space = Space(tuple(Variable(name, "categorical", values=("a", "b", "c")) for name in "uvw"))
    points = space.sample(300, np.random.default_rng(0))
    rule = Rule((Condition(0, values=(1,)), Condition(2, values=(0,))))
    (group,) = groups_of(Outcomes(space, points, rule.holds(points)))
    assert group.rule.text(space) == "u = b and w = a"


def test_points_and_failures_must_have_equal_length() -> None:
    with pytest.raises(
        ValueError, match=rf"points must be \(3, {len(SMALL)}\), got \(2, {len(SMALL)}\)"
    ):
        Outcomes(SMALL, SMALL.sample(2, np.random.default_rng(0)), np.zeros(3, bool))


def test_a_failure_is_no_neighbour_of_its_own() -> None:
    # One of the two others, and half of the one other.
    assert described_radius(SPACE, 3, 1.0) == described_radius(SPACE, 2, 0.5)


def test_if_nine_in_ten_tests_fail_a_rule_still_tells_them_from_the_others() -> None:
    points = SMALL.sample(300, np.random.default_rng(0))
    (group,) = groups_of(Outcomes(SMALL, points, points[:, 0] > 1))
    assert group.rule.text(SMALL) == "x >= 1 m" and group.members.sum() == (points[:, 0] > 1).sum()
