"""The vehicle's dynamics and the law of the emergency brake."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.core.braking import Aeb, EmergencyBrake, Vehicle
from pipeline.core.detections import Detections

CAR = Vehicle(dry_friction=0.8, wet_friction=0.5, build_up_s=0.1, latency_s=0.2)
THESIS: dict[str, Any] = {
    "gate": "truth",
    "law": "confidence",
    "brakes_from": 0.5,
    "votes": 1,
    "window": 1,
    "margin_m": 0.5,
}


def test_friction_falls_until_the_road_is_wet() -> None:
    assert [CAR.full_brake_mps2(rain) for rain in (0, 30, 60, 100)] == pytest.approx(
        [9.81 * 0.8, 9.81 * 0.65, 9.81 * 0.5, 9.81 * 0.5]
    )


def test_stopping_distance_by_hand() -> None:
    car = Vehicle(8 / 9.81, 4 / 9.81, build_up_s=0.1, latency_s=0.2)
    # 16 m/s: 4.8 m in latency and lag, then 256 / 16 m of braking on a dry road,
    # twice that on a wet one.
    assert car.stopping_distance(16.0, rain=0) == pytest.approx(20.8)
    assert car.stopping_distance([0.0, 16.0], rain=100).tolist() == pytest.approx([0.0, 36.8])


def demands(scores: list[list[float]], **changes: Any) -> list[float]:
    """The demands of a brake that sees these scores frame by frame, all of the pedestrian."""
    brake = EmergencyBrake(Aeb(**THESIS | changes))
    frames = [
        Detections(np.zeros((len(one), 4), np.float32), np.array(one, np.float32)) for one in scores
    ]
    return [round(brake.demand(frame, np.ones(len(frame.scores), bool)), 6) for frame in frames]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, [0, 0.75, 0, 1, 0]),
        ({"brakes_from": 0.05}, [0.25, 0.75, 0, 1, 0]),
        ({"law": "threshold"}, [0, 1, 0, 1, 0]),
        ({"votes": 2, "window": 3}, [0, 0, 0, 1, 0]),
        ({"votes": 2, "window": 3, "brakes_from": 0.05}, [0, 0.75, 0, 1, 0]),
    ],
)
def test_laws_by_hand(changes: dict[str, Any], expected: list[float]) -> None:
    assert demands([[0.25], [0.75, 0.5], [], [1.0], []], **changes) == expected


def test_only_followed_detections_brake() -> None:
    both = Detections(np.zeros((2, 4), np.float32), np.array([0.9, 0.6], np.float32))
    assert EmergencyBrake(Aeb(**THESIS)).demand(both, np.array([False, True])) == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("changes", "name"),
    [({"votes": 3, "window": 2}, "votes"), ({"brakes_from": 2.0}, "brakes_from")],
)
def test_a_law_is_checked(changes: dict[str, Any], name: str) -> None:
    with pytest.raises(ValueError, match=name):
        Aeb(**THESIS | changes)


def test_a_score_at_the_lowest_that_brakes_brakes() -> None:
    assert demands([[0.5], [0.4375]], brakes_from=0.5) == [0.5, 0]


@pytest.mark.parametrize("score", [0.7, 0.9])
def test_it_brakes_though_single_precision_makes_a_score_smaller(score: float) -> None:
    assert demands([[score]], brakes_from=score) == [pytest.approx(score)]
