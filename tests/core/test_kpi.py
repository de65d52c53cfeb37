"""Adjusted TTC, failure modes and the KPIs beside it, by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.core.kpi import KPIS, NO_KPI, Kpi, evaluate, running_adj_ttc, told, ttc
from pipeline.core.signals import SIGNALS

Signals = dict[str, NDArray[Any]]
KINDS = {signal.name: signal.kind for signal in SIGNALS}


def signals(**columns: list[float]) -> Signals:
    """An approach at 10 m/s from 4 m; `columns` replace its own."""
    rows = len(next(iter(columns.values()))) if columns else 4
    table: Signals = {name: np.zeros(rows, dtype=kind) for name, kind in KINDS.items()}
    table["time_s"] = np.arange(rows) / 10
    table["ego_speed_mps"] = np.full(rows, 10.0)
    table["conflict_distance_m"] = np.linspace(4, 1, rows)
    table["on_collision_path"] = np.ones(rows, dtype=bool)
    for name, column in columns.items():
        table[name] = np.array(column, dtype=KINDS[name])
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
    result = kpi(
        false_positives=[1, 0, 2, 0],
        false_positives_far=[1, 0, 1, 0],
        false_positives_duplicate=[0, 0, 1, 0],
    )
    assert result.ttc_s == pytest.approx(0.1)
    assert result.adj_ttc_s == pytest.approx(0.025)
    assert (
        result.false_positives,
        result.false_positives_far,
        result.false_positives_duplicate,
    ) == (3, 2, 1)


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
    result = kpi(
        confidence=[0, 0, 0.7, 0], visible_pixels=[29, 30, 500, 500], contrast=[50, 8, 50, 7.9]
    )
    assert [result.first_detection_s, result.first_detection_m] == pytest.approx([0.2, 2.0])
    assert result.missed_frames == 1
    assert np.isnan([kpi().first_detection_s, kpi().first_detection_m]).all()


def test_post_encroachment_needs_both_in_order_and_no_contact() -> None:
    columns: dict[str, list[float]] = {
        "on_collision_path": [1, 0, 0, 0],
        "conflict_distance_m": [3, 2, 1, 0],
    }
    assert kpi(**columns).post_encroachment_s == pytest.approx(0.2)
    assert np.isnan(kpi(**columns, contact=[0, 0, 0, 1]).post_encroachment_s)
    assert np.isnan(kpi(on_collision_path=[1, 1, 1, 1]).post_encroachment_s)
    assert np.isnan(
        kpi(on_collision_path=[1, 1, 1, 0], conflict_distance_m=[1, 0, 0, 0]).post_encroachment_s
    )


def test_post_encroachment_of_a_test_that_ends_before_the_ego_arrives() -> None:
    columns: dict[str, list[float]] = {
        "on_collision_path": [1, 1, 0, 0],
        "conflict_distance_m": [9, 8, 7, 6],
    }
    # It leaves at 0.2 s; at 0.3 s, 6 m are left at 4 m/s.
    assert kpi(**columns, ego_speed_mps=[9, 8, 4, 4]).post_encroachment_s == pytest.approx(1.6)
    assert np.isnan(kpi(**columns, ego_speed_mps=[9, 8, 4, 0]).post_encroachment_s)


def test_a_strategy_takes_a_test_for_a_failure_exactly_if_it_is_one() -> None:
    # Without a collision path, many false positives alone are no failure,
    # and a false activation is one at any adjusted TTC.
    adjusted = np.array([0.05, 0.1, 4.0, 0.05, 4.0, np.nan])
    learnt = told(adjusted, [True, True, False, False, True, False], 0.1)
    assert list(learnt[:5] <= 0.1) == [True, True, False, False, True]
    assert list(learnt[:3]) == [0.05, 0.1, 4.0] and np.isnan(learnt[5])


def test_a_test_without_kpi_has_no_failure_no_count_and_no_number() -> None:
    assert (NO_KPI.failure, NO_KPI.failure_mode, NO_KPI.contact, NO_KPI.false_positives) == (
        False,
        "none",
        False,
        0,
    )
    assert all(np.isnan(getattr(NO_KPI, column.name)) for column in KPIS if column.kind is float)


def test_unnecessary_braking_is_a_failure() -> None:
    # Emergency braking twice, for two and one frames, and once softly; the ego loses 4 m/s.
    columns: dict[str, list[float]] = {
        "time_s": [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
        "ego_speed_mps": [10, 10, 9, 8, 8, 7, 6],
        "conflict_distance_m": [7, 6, 5, 4, 3, 2, 1],
        "gap_m": [7, 6, 5, 4, 3, 2, 1],
        "on_collision_path": [0] * 7,
        "demand_mps2": [0, 5, 7, 0, 6, 2, 0],
    }
    result = kpi(**columns)
    assert (result.failure, result.failure_mode, result.cause) == (
        True,
        "false_activation",
        "false_activation",
    )
    assert (
        result.false_activations,
        round(result.false_activation_s, 6),
        result.speed_loss_mps,
    ) == (2, 0.3, 4)
    soft = kpi(**columns | {"demand_mps2": [0, 4.9, 0, 0, 0, 0, 0]})
    assert (soft.failure, soft.false_activations) == (False, 0)
    # On a collision path, the same braking is right.
    assert kpi(**columns | {"on_collision_path": [1] * 7}).false_activations == 0


def test_false_positives_of_an_average_frame_depend_on_neither_duration_nor_frame_rate() -> None:
    once = {"time_s": [0, 1, 2], "false_positives": [1, 0, 0], "false_positives_far": [1, 0, 0]}
    twice = {name: [*column[:-1], *column[:-1], column[-1]] for name, column in once.items()} | {
        "time_s": [0, 0.5, 1, 1.5, 2]
    }
    one, other = (
        kpi(
            **columns,
            ego_speed_mps=[5.0] * len(columns["time_s"]),
            conflict_distance_m=[10.0] * len(columns["time_s"]),
        )
        for columns in (once, twice)
    )
    assert one.false_positives_per_frame == other.false_positives_per_frame == 0.5
    assert one.adj_ttc_per_frame_s == other.adj_ttc_per_frame_s == pytest.approx(2 / 1.5)
    assert one.adj_ttc_s > other.adj_ttc_s


def test_a_contact_off_the_collision_path_is_a_failure_and_no_false_activation() -> None:
    result = kpi(
        on_collision_path=[0, 0], conflict_distance_m=[4, 0], contact=[0, 1], demand_mps2=[7, 0]
    )
    assert (result.failure, result.failure_mode, result.adj_ttc_s) == (True, "contact", 0)


def test_the_running_adjusted_ttc_counts_all_false_positives_so_far() -> None:
    table = signals(false_positives=[1, 0, 2, 0], on_collision_path=[1, 1, 1, 0])
    assert running_adj_ttc(table) == pytest.approx([0.2, 0.15, 0.05, np.nan], nan_ok=True)


def test_speed_lost_on_the_way_to_or_from_a_collision_path_is_no_unnecessary_loss() -> None:
    result = kpi(
        on_collision_path=[0, 0, 1, 0, 0],
        ego_speed_mps=[10, 9, 7, 4, 4],
        conflict_distance_m=[5, 4, 3, 2, 1],
    )
    assert result.speed_loss_mps == 1


def test_a_pedestrian_who_leaves_as_the_ego_arrives_leaves_no_time() -> None:
    assert (
        kpi(on_collision_path=[1, 1, 0, 0], conflict_distance_m=[2, 1, 0, 0]).post_encroachment_s
        == 0
    )


def test_a_false_activation_that_lasts_until_the_end_ends_with_the_test() -> None:
    result = kpi(on_collision_path=[0] * 4, demand_mps2=[0, 0, 6, 6])
    assert (result.false_activations, result.false_activation_s) == pytest.approx((1, 0.1))


def test_a_ttc_at_the_threshold_is_late_whatever_the_false_positives() -> None:
    assert kpi(conflict_distance_m=[4, 1], false_positives=[1, 0]).failure_mode == "late"
