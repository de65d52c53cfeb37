from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.reliability import Calibration, calibration_error, platt, reliability


def test_calibration_by_hand() -> None:
    odds_times_ten = Calibration(1.0, float(np.log(10)))
    assert odds_times_ten.apply([0.5, 1 / 11]) == pytest.approx([10 / 11, 0.5])
    assert Calibration().apply([0.2, 0.9]) == pytest.approx([0.2, 0.9])


def test_order_stays_even_at_the_edges() -> None:
    scores = Calibration(2.4, 1.4).apply([0.0, 0.01, 0.3, 0.31, 1.0])
    assert (np.diff(scores) > 0).all()
    assert (scores >= 0).all()
    assert (scores <= 1).all()


def test_undoing_a_calibration_gives_the_scores_back() -> None:
    calibration, scores = Calibration(1.5, -0.7), np.array([0.01, 0.3, 0.5, 0.999])
    assert calibration.undo(calibration.apply(scores)) == pytest.approx(scores)
    # Limits of float: no score is 0 or 1.
    assert Calibration(0.1, 5).undo([1e-6, 1 - 1e-6]) == pytest.approx([1e-6, 1 - 1e-6])


def test_platt_finds_the_calibration_that_made_the_data() -> None:
    rng = np.random.default_rng(0)
    scores = rng.uniform(0.02, 0.98, 20_000)
    right = rng.random(20_000) < Calibration(2.0, 1.0).apply(scores)
    calibration = platt(scores, right)
    assert (calibration.slope, calibration.offset) == pytest.approx((2.0, 1.0), abs=0.1)


@pytest.mark.parametrize("right", [[True, True, True], [False, False, False], [True, False, False]])
def test_an_uninformative_score_gives_the_identity(right: list[bool]) -> None:
    assert platt([0.2, 0.5, 0.8], right) == Calibration()


@pytest.mark.parametrize(
    ("slope", "offset"), [(0.0, 0.0), (-1.0, 0.0), (float("nan"), 0.0), (1.0, float("inf"))]
)
def test_ranges_are_checked(slope: float, offset: float) -> None:
    with pytest.raises(ValueError, match="slope must be positive"):
        Calibration(slope, offset)


def test_diagram_and_error_by_hand() -> None:
    diagram = reliability([0.05, 0.15, 0.19, 0.95, 1.0], [False, True, False, True, True])
    assert [(round(b.score, 3), b.right, b.count) for b in diagram] == [
        (0.05, 0.0, 1),
        (0.17, 0.5, 2),
        (0.975, 1.0, 2),
    ]
    assert calibration_error(diagram) == pytest.approx((0.05 + 2 * 0.33 + 2 * 0.025) / 5)
    assert reliability([], []) == () and calibration_error(()) == 0.0
    with pytest.raises(ValueError, match="must be lists of equal length"):
        reliability([0.1, 0.2], [True])


def test_a_bin_ends_where_the_next_begins() -> None:
    assert [b.count for b in reliability([0.0, 0.099, 0.1, 0.16, 0.2, 0.99, 1.0], [True] * 7)] == [
        2,
        2,
        1,
        2,
    ]
