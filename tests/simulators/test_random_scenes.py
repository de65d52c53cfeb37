"""The content of the base set, and how often each kind appears."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from pipeline.config.composing import compose
from pipeline.config.sections import Rarity
from pipeline.scenarios.people import FIRST_RANDOM, fingerprint, person
from pipeline.simulators.mujoco import random_scenes
from pipeline.steps.render_scenes import scene_settings


def conditions(rare: Rarity, count: int) -> list[dict[str, Any]]:
    rng = np.random.default_rng(0)
    return [random_scenes._conditions(1000, rare, rng) for _ in range(count)]


@pytest.mark.parametrize(("children", "crouching"), [(0.15, 0.15), (0.4, 1), (1, 1)])
def test_children_and_crouching_people_are_as_frequent_as_the_setting_says(
    children: float, crouching: float
) -> None:
    drawn = conditions(Rarity(children=children, crouching=crouching), 20_000)
    people, poses = Counter(c["blueprint"] for c in drawn), Counter(c["animation"] for c in drawn)
    assert len(people) == 74 and len(poses) == 6
    a_child = sum(count for name, count in people.items() if person(name).child) / 8
    an_adult = sum(count for name, count in people.items() if not person(name).child) / 66
    assert a_child / an_adult == pytest.approx(children, rel=0.12)
    assert poses["crouching"] / (len(drawn) - poses["crouching"]) * 5 == pytest.approx(
        crouching, rel=0.12
    )


def test_conditions_describe_the_person() -> None:
    for drawn in conditions(Rarity(children=1, crouching=1), 200):
        shown = person(drawn["blueprint"])
        assert (drawn["height_m"], drawn["umbrella"], drawn["people"]) == (
            shown.height,
            shown.umbrella,
            fingerprint(1000),
        )


def test_each_shard_draws_its_own_town_and_people() -> None:
    worlds = [random_scenes._world(np.random.default_rng([0, shard])) for shard in range(400)]
    assert (
        len({town.fingerprint for town, _ in worlds})
        == len({people for _, people in worlds})
        == 400
    )
    assert all(people >= FIRST_RANDOM for _, people in worlds)


def test_new_scenes_show_other_worlds_than_the_base_set_and_balanced_ones_all_people_alike() -> (
    None
):
    config = compose("default", ["retraining.added_frames=10", "retraining.rounds=2"])
    base, new, other = (
        config.base_set,
        scene_settings(config, "new_scenes", 0),
        scene_settings(config, "new_scenes", 1),
    )
    balanced = scene_settings(config, "balanced_scenes", 0)
    assert (
        len({base.seed, new.seed, other.seed}) == 3 and new.seed == balanced.seed > base.seed + 1000
    )
    assert new.rare == base.rare != balanced.rare == Rarity(children=1, crouching=1)
    assert (new.images, new.validation_share) == (30, 0)
