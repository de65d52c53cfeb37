"""Stopping distances, and tests that a detector could have passed."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.braking import solvable, stopping_distance


def test_stopping_distance_by_hand() -> None:
    # 16 m/s: 1.6 m in the lag, 256 / 16 m of braking.
    assert stopping_distance(16.0) == pytest.approx(17.6)
    assert stopping_distance([0.0, 8.0]).tolist() == pytest.approx([0.0, 4.8])


@pytest.mark.parametrize(
    ("distance", "pixels", "contrast", "expected"),
    [
        ([30, 20, 10], [0, 40, 90], [0, 20, 20], True),
        ([30, 20, 10], [0, 0, 90], [0, 0, 20], False),
        ([30, 20, 10], [0, 29, 90], [0, 20, 20], False),
        ([30, 20, 10], [90, 90, 90], [7, 7, 20], False),
        ([30, 20, 10], [0, 0, 0], [0, 0, 0], False),
        ([30, 17.7, 10], [0, 30, 0], [0, 8, 0], True),
    ],
)
def test_a_person_must_see_the_pedestrian_in_time(distance: list[float], pixels: list[int], contrast: list[float], expected: bool) -> None:
    columns = {"ego_speed_mps": [16.0] * 3, "conflict_distance_m": distance, "visible_pixels": pixels, "contrast": contrast}
    assert solvable({name: np.array(values) for name, values in columns.items()}) is expected
