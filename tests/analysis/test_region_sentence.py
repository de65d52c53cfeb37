"""The sentences about a region."""

from __future__ import annotations

from typing import Any

import pytest

from pipeline.analysis.region_sentence import plain, sentence, subject
from pipeline.artefacts.region_results import Repair, RuleCondition, Seen

SEEN = Seen(
    failures=20,
    in_sight=20,
    detected=18,
    first_sight_m=21,
    first_sight_pixels=40,
    first_sight_contrast=12,
    last_chance_pixels=90,
    last_chance_contrast=15,
    first_detection_m=9.2,
    delay_s=0.62,
)


def conditions(*texts: str) -> list[RuleCondition]:
    return [RuleCondition(variable="x", text=text) for text in texts]


def repair(change: str, repaired: int, variables: int = 1) -> Repair:
    values: dict[str, Any] = {f"v{i}": 0.0 for i in range(variables)}
    return Repair(
        change=change, values=values, without=(), tests=20, repaired=repaired, errors=0, rate=None
    )


@pytest.mark.parametrize(
    ("texts", "expected"),
    [
        (("child", "rain >= 40 %"), "Children with rain of at least 40 %"),
        (("height_m <= 1.25",), "People at most 1.25 m tall"),
        (
            ("child", "height_m in [1.2, 1.25]", "in bright trousers", "fog >= 40 %"),
            "Children 1.2 to 1.25 m tall in bright trousers with fog of at least 40 %",
        ),
        (("animation in {crouching, stumble}",), "Crouching or stumbling people"),
        (("animation in {stumble, limping, drunk}", "adult"), "Stumbling, limping or drunk adults"),
        (
            ("trousers_brightness in [0.6, 0.65]",),
            "People with trousers brightness from 0.6 to 0.65",
        ),
        (("crouching", "under an umbrella"), "Crouching people under an umbrella"),
        (("under an umbrella", "adult", "limping"), "Limping adults under an umbrella"),
        (
            (
                "sun_altitude in [-1, 2] deg",
                "pedestrian_speed <= 0.75 m/s",
                "rain - fog in [-12, 12] %",
            ),
            "People with sun altitude from -1 to 2 deg, pedestrian speed of at most 0.75 m/s and "
            "rain - fog from -12 to 12 %",
        ),
        (
            ("crouching", "under an umbrella", "hat = 0"),
            "Crouching people under an umbrella without a hat",
        ),
        ((), "People in every test"),
    ],
)
def test_the_subject_says_the_rule(texts: tuple[str, ...], expected: str) -> None:
    assert subject(conditions(*texts)) == expected


def test_people_listed_by_name_are_children_if_all_of_them_are() -> None:
    def listed(*names: str) -> RuleCondition:
        return RuleCondition(
            variable="blueprint", text=f"blueprint in {{{', '.join(names)}}}", values=names
        )

    assert subject([listed("M 34", "W 37")]) == "Children (M 34 or W 37)"
    assert subject([listed("M 34", "W 01")]) == "People (M 34 or W 01)"
    assert subject(
        [
            listed("M 34", "W 01"),
            RuleCondition(variable="blueprint", text="hat = 0", values=("M 34", "M 02")),
        ]
    ) == ("Children (M 34 or W 01) without a hat")


def test_listed_values_and_circles() -> None:
    assert plain("blueprint in {W 04, M 04, M 35}") == "blueprint W 04, M 04 or M 35"
    assert plain("animation = drunk") == "animation drunk"
    assert (
        plain("sun_azimuth from 330 through 360 to 30 deg")
        == "sun azimuth from 330 through 360 to 30 deg"
    )


def test_the_whole_text() -> None:
    repairs = [
        repair("a taller person (M 12)", 14),
        repair("no rain", 3),
        repair("no fog", 1),
        repair("clear weather by day", 14, 4),
    ]
    text = sentence(conditions("child"), SEEN, repairs, repair("other noise", 1, 0))
    assert text == (
        "Children are first detected 0.6 s after they come into sight, 9 m before the conflict "
        "point. "
        "Medians of 20 failures; 2 are never detected. Repairs: a taller person (M 12) 14 of 20, "
        "no rain 3 of 20, other noise 1 of 20."
    )


def test_clear_weather_is_named_if_it_repairs_more_than_any_part() -> None:
    text = sentence([], SEEN, [repair("no rain", 3), repair("clear weather by day", 12, 4)], None)
    assert text.endswith(". Repairs: no rain 3 of 20, clear weather by day 12 of 20.")


def test_nothing_repairs() -> None:
    assert sentence([], SEEN, [repair("no rain", 0)], repair("other noise", 0, 0)).endswith(
        ". No single change repairs any of 20, other noise 0 of 20."
    )


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"in_sight": 0}, "are never in sight (20 failures)."),
        (
            {"delay_s": None, "detected": 0},
            "come into sight 21 m before the conflict point and are never detected (median",
        ),
        (
            {"delay_s": None, "detected": 1, "in_sight": 19},
            "never detected, except for 1 never in sight (median of 19 failures).",
        ),
        ({"delay_s": -0.1}, "are first detected as soon as they come into sight, 9 m before"),
        ({"detected": 19}, ". Medians of 20 failures; 1 is never detected."),
        ({"detected": 20}, ". Medians of 20 failures."),
    ],
)
def test_what_the_camera_saw(changes: dict[str, Any], expected: str) -> None:
    assert expected in sentence([], SEEN.model_copy(update=changes), [], None)
