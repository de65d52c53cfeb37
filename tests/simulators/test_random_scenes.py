"""The content of the base set, and how often each kind appears."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from pipeline.simulators.mujoco import random_scenes
from pipeline.simulators.mujoco.blueprints import BLUEPRINTS, CHILDREN, NAMES


def test_children_are_shorter_than_one_and_a_half_metres() -> None:
    assert {name for name in NAMES if BLUEPRINTS[name].height < 1.45} == set(CHILDREN)


def test_children_are_rare_in_the_base_set_and_every_blueprint_appears() -> None:
    rng = np.random.default_rng(0)
    drawn = Counter(random_scenes._drawn(NAMES, set(CHILDREN), rng) for _ in range(40_000))
    assert set(drawn) == set(NAMES)
    one_child = sum(drawn[name] for name in CHILDREN) / len(CHILDREN)
    one_adult = sum(count for name, count in drawn.items() if name not in CHILDREN) / (len(NAMES) - len(CHILDREN))
    assert one_child / one_adult == pytest.approx(random_scenes.RARE, rel=0.15)
