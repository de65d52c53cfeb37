"""Populations of pedestrians: reproducible, of known make, and without common people or names."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.scenarios.people import OF_EACH_SEX, fingerprint, person, population, variable

NUMBERS = st.integers(1, 2**31)


def test_population_1_has_the_names_of_the_thesis_space() -> None:
    assert list(population(1)) == [f"{sex} {number:02d}" for sex in "WM" for number in range(1, 38)]
    assert list(population(2)) == [f"{sex} {number}" for sex in "WM" for number in range(38, 75)]


@given(NUMBERS)
def test_a_population_is_37_women_and_37_men_with_four_children_each(number: int) -> None:
    people = list(population(number).values())
    assert [p.name[0] for p in people] == ["W"] * OF_EACH_SEX + ["M"] * OF_EACH_SEX
    for half in (people[:OF_EACH_SEX], people[OF_EACH_SEX:]):
        assert [p.child for p in half] == [False] * 33 + [True] * 4
    assert all(1.1 <= p.height <= 1.4 if p.child else 1.5 <= p.height <= 1.98 for p in people)
    assert all(
        0.88 <= p.stride <= 1.12 and 0.5 <= p.arm_swing <= 1.5 and 0 <= p.stoop <= 0.12
        for p in people
    )
    assert not any(p.umbrella for p in people if p.child) and not any(
        p.skirt for p in people[OF_EACH_SEX:]
    )
    assert all(
        0 <= c < 1
        for p in people
        for colour in (p.top, p.trousers, p.shoes, p.skin, p.hair, p.accent)
        for c in colour
    )


@given(NUMBERS)
def test_a_number_always_makes_the_same_people(number: int) -> None:
    before = dict(population(number))
    population.cache_clear()
    assert before == population(number)


@given(NUMBERS, NUMBERS)
def test_two_populations_share_no_name_no_person_and_no_fingerprint(
    number: int, other: int
) -> None:
    if number == other:
        return
    first, second = population(number), population(other)
    assert not set(first) & set(second) and fingerprint(number) != fingerprint(other)
    looks = set()
    for blueprint in (*first.values(), *second.values()):
        looks.add(tuple(value for key, value in vars(blueprint).items() if key != "name"))
    assert len(looks) == 148


@given(NUMBERS)
def test_everybody_is_found_by_name(number: int) -> None:
    for name, blueprint in population(number).items():
        assert person(name) == blueprint


@pytest.mark.parametrize("name", ["W 00", "W 001", "X 01", "W01", "W 1", ""])
def test_other_names_are_refused(name: str) -> None:
    with pytest.raises(
        ValueError, match=f"expected a person such as 'W 01' or 'M 38', got '{name}'"
    ):
        person(name)


def test_there_is_no_population_0() -> None:
    with pytest.raises(ValueError, match="the number of a population must be at least 1, got 0"):
        population(0)


def test_a_fingerprint_is_16_digits_of_the_sha256_of_the_number() -> None:
    assert fingerprint(1) == "ddd15778c18403d0"


def test_people_follow_the_described_distribution() -> None:
    """Over 60 populations, within three standard errors."""
    people = [p for number in range(1, 61) for p in population(number).values()]
    for sex, mean in (("W", 1.66), ("M", 1.79)):
        heights = [p.height for p in people if p.name[0] == sex and not p.child]
        assert np.mean(heights) == pytest.approx(mean, abs=3 * 0.07 / np.sqrt(len(heights)))
    assert np.mean([p.stride for p in people]) == pytest.approx(
        1, abs=3 * 0.06 / np.sqrt(len(people))
    )
    for shares, expected in (
        ([p.hat for p in people], 0.2),
        ([p.bag for p in people], 0.3),
        ([p.umbrella for p in people if not p.child], 0.12),
        ([p.skirt for p in people if p.name[0] == "W"], 0.35),
    ):
        assert np.mean(shares) == pytest.approx(
            expected, abs=3 * np.sqrt(expected * (1 - expected) / len(shares))
        )


def test_the_variable_describes_each_person() -> None:
    plain, people = variable(2), population(2)
    attributes = plain["attributes"]
    assert plain["values"] == list(people)
    assert attributes["height_m"] == [p.height for p in people.values()]
    for name in ("umbrella", "bag", "hat", "skirt"):
        assert attributes[name] == [getattr(p, name) for p in people.values()]
    for part in ("top", "trousers"):
        assert attributes[f"{part}_brightness"] == pytest.approx(
            [np.mean(getattr(p, part)) for p in people.values()], abs=5.1e-4
        )
