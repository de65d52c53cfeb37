"""The front-car experiment: its random points and its table, by hand."""

from __future__ import annotations

import front_car
import numpy as np
import pandas as pd

from pipeline.artefacts.front_car_results import CoveredPoint, Points
from pipeline.config.composing import compose

CONFIG = compose("front_car", ["front_car.seed=3"])
SPACE = CONFIG.front_car.space.space()


def point_of(row: np.ndarray) -> CoveredPoint:
    values = {name: str(value) for name, value in SPACE.decode(row.astype(float)).items()}
    return CoveredPoint(name="P", values=values, covered=0)


def test_further_points_are_random_feasible_and_new() -> None:
    feasible = CONFIG.front_car.space.feasible_points()
    proposed = Points(k=2, existing=5, required=69, points=tuple(map(point_of, feasible[:11])))
    drawn = front_car.drawn(CONFIG, proposed)
    assert (
        drawn.points[:5] == proposed.points[:5]
        and drawn != proposed
        and drawn == front_car.drawn(CONFIG, proposed)
    )
    assert [point.name for point in drawn.points[5:]] == ["R1", "R2", "R3", "R4", "R5", "R6"]
    encoded = np.array([SPACE.encode(dict(point.values)) for point in drawn.points]).astype(int)
    assert len(np.unique(encoded, axis=0)) == 11 and SPACE.constraints.holds(encoded).all()
    covered = [point.covered for point in drawn.points[5:]]
    assert covered == sorted(covered) and covered[0] > 0


def test_the_table_by_hand() -> None:
    right = {"existing": ["1000", "1100"], "covered": ["1110", "1110"], "random": ["1110", "1111"]}
    rows = [
        {
            "seed": seed,
            "version": version,
            "points": 5 if version == "existing" else 9,
            "pairs": 60,
            "ap50": 0.5,
            "right": texts[seed],
        }
        for seed in (0, 1)
        for version, texts in right.items()
    ]
    text = front_car.answer(pd.DataFrame(rows))
    assert "2 seeds, 4 test snapshots each." in text
    assert "| 0 | 5 and 9 | 60, 60, 60 | 0.250 | 0.750 | 0.750 | 0.500, 0.500, 0.500 |" in text
    # Differences 0.5 and 0.25: 0.375 +- 25.45 x 0.125.
    assert "| `covered` minus `existing` | +0.375 | -2.806 to +3.556 | no |" in text
    assert "97.5 % interval" in text
