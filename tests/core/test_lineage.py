"""The versions of a study and the campaigns that feed them."""

from __future__ import annotations

import pytest

from pipeline.core.lineage import Version, versions
from pipeline.errors import InputError


def test_versions_by_round_arm_and_seed() -> None:
    names = [str(version) for version in versions(["control", "random", "adaptive"], 2, [7, 8])]
    assert names[:7] == [
        "base",
        "control",
        "control-s8",
        "random",
        "random-s8",
        "adaptive",
        "adaptive-s8",
    ]
    assert names[7:] == [
        "control-r2",
        "control-r2-s8",
        "random-r2",
        "random-r2-s8",
        "adaptive-r2",
        "adaptive-r2-s8",
    ]
    assert all(str(Version.named(name)) == name for name in names)


def test_parents_groups_and_tested_versions() -> None:
    third = Version.named("adaptive-r3-s8")
    assert [str(version) for version in third.tested] == ["base", "adaptive-s8", "adaptive-r2-s8"]
    assert (str(third.parent), third.group) == ("adaptive-r2-s8", "adaptive-r3")
    assert Version().parent is None and Version().tested == ()


def test_a_plain_word_names_a_version_of_the_first_round() -> None:
    assert (Version.named("new_scenes"), Version.named("base")) == (
        Version("new_scenes", 1),
        Version(),
    )


@pytest.mark.parametrize("name", ["base-r2", "adaptive-r", "adaptive-r0", "adaptive-r1", ""])
def test_other_names_are_refused(name: str) -> None:
    with pytest.raises(
        InputError,
        match=rf"^expected the name of a version, such as base or adaptive-r2-s1, got '{name}'$",
    ):
        Version.named(name)
