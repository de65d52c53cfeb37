"""Adjusted TTC, failure modes and the KPIs beside it, by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.core.episode import SIGNALS
from pipeline.core.kpi import Kpi, evaluate, match, ttc

Signals = dict[str, NDArray[Any]]
BOX = (10.0, 10.0, 20.0, 30.0)


def signals(**columns: list[float]) -> Signals:
    """An approach at 10 m/s from 4 m, with `columns` in place of its own."""
    rows = len(next(iter(columns.values()))) if columns else 4
    table: Signals = {name: np.zeros(rows, dtype=kind) for name, kind in SIGNALS.items()}
    table["time_s"] = np.arange(rows) / 10
    table["ego_speed_mps"] = np.full(rows, 10.0)
    table["conflict_distance_m"] = np.linspace(4, 1, rows)
    table["on_collision_path"] = np.ones(rows, dtype=bool)
    for name, column in columns.items():
        table[name] = np.array(column, dtype=SIGNALS[name])
    table["ttc_s"] = ttc(table)
    return table


def kpi(**columns: list[float]) -> Kpi:
    return evaluate(signals(**columns), 0.1)


def test_ttc_counts_rows_on_a_collision_path_of_a_moving_ego() -> None:
    table = signals(
        conflict_distance_m=[4, 3, 2, 1, 0.5],
        ego_speed_mps=[10, 10, 0.05, 10, 3],
        on_collision_path=[1, 1, 1, 0, 0],
        contact=[0, 0, 0, 0, 1],
    )
    assert np.array_equal(ttc(table), [0.4, 0.3, np.nan, np.nan, 0], equal_nan=True)


def test_false_positives_divide_the_shortest_ttc() -> None:
    result = kpi(false_positives=[1, 0, 2, 0], false_positives_far=[1, 0, 1, 0], false_positives_duplicate=[0, 0, 1, 0])
    assert result.ttc_s == pytest.approx(0.1)
    assert result.adj_ttc_s == pytest.approx(0.025)
    assert (result.false_positives, result.false_positives_far, result.false_positives_duplicate) == (3, 2, 1)


def test_the_threshold_itself_is_a_failure() -> None:
    table = signals(conflict_distance_m=[4, 1], ego_speed_mps=[10, 10])
    assert evaluate(table, 0.1).failure
    assert not evaluate(table, 0.0999).failure


@pytest.mark.parametrize(
    ("columns", "mode"),
    [
        ({"conflict_distance_m": [4, 3]}, "none"),
        ({"conflict_distance_m": [4, 0.5]}, "late"),
        ({"conflict_distance_m": [4, 0], "contact": [0, 1]}, "contact"),
        ({"conflict_distance_m": [4, 3], "false_positives": [1, 1]}, "false_positives"),
        ({"conflict_distance_m": [4, 0.5], "false_positives": [1, 1]}, "late"),
    ],
)
def test_failure_mode(columns: dict[str, list[float]], mode: str) -> None:
    assert kpi(**columns).failure_mode == mode


def test_without_a_collision_path_the_first_row_stands_for_the_ttc() -> None:
    result = kpi(on_collision_path=[0, 0, 0, 0])
    assert result.ttc_s == pytest.approx(0.4)
    stopped = kpi(on_collision_path=[0, 0], ego_speed_mps=[0, 0], conflict_distance_m=[4, 4])
    assert np.isfinite(stopped.adj_ttc_s)


def test_impact_speed_is_that_of_the_contact() -> None:
    result = kpi(contact=[0, 0, 1], ego_speed_mps=[9, 8, 7], gap_m=[3, 2, 0])
    assert (result.contact, result.impact_speed_mps, result.smallest_gap_m) == (True, 7, 0)
    assert kpi().impact_speed_mps == 0


def test_first_detection_and_missed_frames() -> None:
    result = kpi(confidence=[0, 0, 0.7, 0], visible_pixels=[29, 30, 500, 500], contrast=[50, 8, 50, 7.9])
    assert [result.first_detection_s, result.first_detection_m] == pytest.approx([0.2, 2.0])
    assert result.missed_frames == 1
    assert np.isnan([kpi().first_detection_s, kpi().first_detection_m]).all()


def test_post_encroachment_needs_both_in_order_and_no_contact() -> None:
    columns: dict[str, list[float]] = {"on_collision_path": [1, 0, 0, 0], "conflict_distance_m": [3, 2, 1, 0]}
    assert kpi(**columns).post_encroachment_s == pytest.approx(0.2)
    assert np.isnan(kpi(**columns, contact=[0, 0, 0, 1]).post_encroachment_s)
    assert np.isnan(kpi(on_collision_path=[1, 1, 1, 1]).post_encroachment_s)
    assert np.isnan(kpi(on_collision_path=[1, 1, 1, 0], conflict_distance_m=[1, 0, 0, 0]).post_encroachment_s)


def test_match_sorts_detections_into_kinds() -> None:
    boxes = [BOX, (10, 10, 20, 29), (10, 10, 20, 18), (100, 10, 110, 30)]
    result = match(boxes, [0.6, 0.9, 0.8, 0.7], BOX, BOX, 200, 50.0)
    assert result.outcomes == ("duplicate", "true_positive", "localisation", "far")
    assert (result.confidence, result.false_positives) == (0.9, 3)


def test_match_ignores_what_lies_on_a_barely_visible_pedestrian_but_lets_it_brake() -> None:
    boxes = [BOX, (10, 10, 20, 18), (100, 10, 110, 30)]
    for pixels, contrast in ((29, 50.0), (200, 7.9)):
        result = match(boxes, [0.9, 0.8, 0.7], BOX, BOX, pixels, contrast)
        assert result.outcomes == ("ignored", "ignored", "far")
        assert result.confidence == 0.9


def test_match_without_a_pedestrian_or_without_detections() -> None:
    assert match([BOX], [0.9], None, None, 0, 0.0).outcomes == ("far",)
    hidden = match([BOX], [0.9], None, BOX, 0, 0.0)
    assert (hidden.outcomes, hidden.confidence) == (("ignored",), 0)
    assert match([], [], BOX, BOX, 200, 50.0).confidence == 0


def test_an_iou_of_exactly_a_half_is_a_localisation_error() -> None:
    assert match([(10, 10, 20, 20)], [0.9], BOX, BOX, 200, 50.0).outcomes == ("localisation",)
