"""The cause of a failure, from hand-made signals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.core.causes import cause, solvable

SEEN: dict[str, list[float]] = {"visible_pixels": [0, 90, 90, 90], "contrast": [0, 20, 20, 20]}
SIGNALS: dict[str, list[float]] = {
    "conflict_distance_m": [40, 30, 20, 10],
    "stopping_distance_m": [15, 15, 15, 15],
    **SEEN,
    "confidence": [0, 0, 0, 0],
    "any_confidence": [0, 0, 0, 0],
    "overlap": [0, 0, 0, 0],
    "lost": [0, 0, 0, 0],
    "ego_speed_mps": [10, 10, 10, 10],
}


def signals(**changes: list[float]) -> dict[str, Any]:
    return {name: np.array(values) for name, values in {**SIGNALS, **changes}.items()}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, "never_seen"),
        (
            {
                "confidence": [0, 0, 0, 0.9],
                "overlap": [0, 0, 0, 0.8],
                "any_confidence": [0, 0, 0, 0.9],
            },
            "too_late",
        ),
        ({"overlap": [0, 0.4, 0.3, 0.4]}, "box"),
        ({"any_confidence": [0, 0.3, 0.6, 0.6]}, "confidence"),
        ({"overlap": [0, 0.4, 0, 0], "any_confidence": [0, 0, 0.6, 0.7]}, "box"),
        # A box after the last chance does not count,
        # but shows that the detector can see the pedestrian.
        ({"overlap": [0, 0, 0, 0.4]}, "too_late"),
        # Detected all the time, and still too late: the brake was too weak.
        (
            {
                "confidence": [0, 0.5, 0.5, 0.5],
                "overlap": [0, 0.7, 0.7, 0.7],
                "any_confidence": [0, 0.5, 0.5, 0.5],
            },
            "too_late",
        ),
        # Braked in the first frame; later it is lost, and the ego is faster at the end.
        (
            {
                "confidence": [0.5, 0, 0, 0],
                "overlap": [0.7, 0, 0, 0],
                "any_confidence": [0.5, 0, 0, 0],
                "lost": [0, 1, 1, 1],
                "ego_speed_mps": [10, 8, 8, 9],
            },
            "lost_after_detection",
        ),
        ({"visible_pixels": [0, 0, 0, 90]}, "not_solvable"),
    ],
)
def test_causes_by_hand(changes: dict[str, list[float]], expected: str) -> None:
    assert cause(signals(**changes), "late") == expected


@pytest.mark.parametrize("mode", ["none", "false_positives", "false_activation"])
def test_other_modes_are_their_own_cause(mode: str) -> None:
    assert cause(signals(), mode) == mode


@pytest.mark.parametrize(
    ("distance", "pixels", "contrast", "expected"),
    [
        ([30, 20, 10], [0, 40, 90], [0, 20, 20], True),
        ([30, 20, 10], [0, 0, 90], [0, 0, 20], False),
        ([30, 20, 10], [0, 29, 90], [0, 20, 20], False),
        ([30, 20, 10], [90, 90, 90], [7, 7, 20], False),
        ([30, 17.7, 10], [0, 30, 0], [0, 8, 0], True),
        ([30, 17.6, 10], [0, 30, 0], [0, 8, 0], False),
    ],
)
def test_a_person_must_see_the_pedestrian_in_time(
    distance: list[float], pixels: list[int], contrast: list[float], expected: bool
) -> None:
    columns = {
        "stopping_distance_m": [17.6] * 3,
        "conflict_distance_m": distance,
        "visible_pixels": pixels,
        "contrast": contrast,
    }
    assert solvable({name: np.array(values) for name, values in columns.items()}) is expected
