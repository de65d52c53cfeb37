"""What the camera saw, from hand-made signals."""

from __future__ import annotations

import numpy as np

from pipeline.core.sight import Sight, sight

SIGNALS = {
    "time_s": [0.0, 0.1, 0.2, 0.3, 0.4],
    "conflict_distance_m": [40.0, 30, 20, 10, 0],
    "stopping_distance_m": [15.0, 15, 15, 15, 15],
    # 30 pixels at a contrast of 8 are the least that a person makes out.
    "visible_pixels": [29.0, 30, 60, 90, 0],
    "contrast": [50.0, 8, 12, 20, 0],
    "confidence": [0.0, 0, 0, 0.7, 0],
}


def seen(**changes: list[float]) -> Sight:
    return sight({name: np.array(values) for name, values in {**SIGNALS, **changes}.items()})


def test_first_sight_last_chance_and_first_detection() -> None:
    assert seen() == Sight(
        first_sight_s=0.1,
        first_sight_m=30,
        first_sight_pixels=30,
        first_sight_contrast=8,
        last_chance_s=0.2,
        last_chance_pixels=60,
        last_chance_contrast=12,
        first_detection_s=0.3,
        first_detection_m=10,
    )


def test_the_end_of_a_test_is_no_last_chance() -> None:
    stopped = seen(conflict_distance_m=[40, 30, 14, 9, 4], stopping_distance_m=[15, 15, 15, 10, 0])
    assert (stopped.last_chance_s, stopped.last_chance_pixels) == (0.1, 30)


def test_what_never_comes_has_no_value() -> None:
    never = seen(contrast=[0] * 5, confidence=[0] * 5, conflict_distance_m=[5] * 5)
    assert np.isnan(list(vars(never).values())).all()
    assert (
        np.isnan(seen(confidence=[0] * 5).first_detection_m)
        and seen(confidence=[0] * 5).first_sight_m == 30
    )
