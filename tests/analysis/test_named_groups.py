"""Named groups of tests, by hand-computed points."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.analysis.named_groups import MOST_VALUES, named_groups
from pipeline.config.composing import compose
from pipeline.core.space import Space
from pipeline.core.variable import Variable

POSES = Variable("animation", "categorical", values=("walking", "crouching"))


def test_the_groups_of_the_held_out_points() -> None:
    space = compose("default", []).space("F1star")
    points = np.tile(space.sample(1, np.random.default_rng(0)), (4, 1))
    # Population 2: W 38 to W 74 and M 38 to M 74, the last four of each are children.
    set_to: dict[str, list[float | str]] = {
        "animation": ["walking", "crouching", "crouching", "drunk"],
        "blueprint": ["W 38", "W 70", "W 71", "M 74"],
        "sun_altitude": [-20, -0.1, 0, 90],
        "rain": [0, 49.9, 50, 100],
    }
    for name, values in set_to.items():
        column = space.names.index(name)
        points[:, column] = [space.variables[column].encode(value) for value in values]
    groups = {name: rows.tolist() for name, rows in named_groups(space, points).items()}
    poses = space.variables[space.names.index("animation")].values
    assert set(groups) == {
        *(f"animation = {pose}" for pose in poses),
        "children",
        "adults",
        "night",
        "rain",
    }
    assert groups["animation = crouching"] == [False, True, True, False] and not any(
        groups["animation = limping"]
    )
    assert groups["children"] == [False, False, True, True] and groups["adults"] == [
        True,
        True,
        False,
        False,
    ]
    assert groups["night"] == [True, True, False, False] and groups["rain"] == [
        False,
        False,
        True,
        True,
    ]


def test_a_space_without_these_variables_has_the_groups_of_its_categories_alone() -> None:
    fog = Variable("fog", "continuous", low=0, high=100, step=10)
    space = Space((fog, POSES))
    assert list(named_groups(space, space.sample(5, np.random.default_rng(0)))) == [
        "animation = walking",
        "animation = crouching",
    ]


@pytest.mark.parametrize(("values", "groups"), [(MOST_VALUES, MOST_VALUES), (MOST_VALUES + 1, 0)])
def test_a_variable_with_many_values_has_no_groups(values: int, groups: int) -> None:
    space = Space((Variable("shop", "categorical", values=tuple(map(str, range(values)))),))
    assert len(named_groups(space, space.sample(3, np.random.default_rng(0)))) == groups
