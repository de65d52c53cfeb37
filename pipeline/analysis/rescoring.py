"""Judges stored tests again, from their detections and signals, at any IoU, threshold and brake law.

Shares no code with the closed loop, so that it checks the loop: the loop's code handles one frame, this one whole tables.
"""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.core.braking import Aeb
from pipeline.core.car import Car
from pipeline.core.kpi import KPIS, evaluate
from pipeline.core.matching import TOUCH_IOU, Criterion
from pipeline.core.signals import SIDES, SIGNALS
from pipeline.core.visibility import visible

Floats = NDArray[np.float64]
KEY = ["test_id", "step"]


def rescored(signals: pd.DataFrame, detections: pd.DataFrame, car: Car) -> pd.DataFrame:
    """The signals with everything that depends on the detections computed again. signals, detections: tables of the same tests.

    The ego's motion stays as it was driven: where `brake` differs from the stored one, the car would have driven otherwise.
    """
    result = signals.copy()
    judged = _judged(signals, detections, car)
    frames = pd.MultiIndex.from_frame(signals[KEY])
    for name, column in _per_frame(judged, car).items():
        filled = column.reindex(frames, fill_value=0).to_numpy()
        result[name] = filled.astype(np.int64) if name.startswith("false_positives") else filled
    result["brake"] = _demand(result["test_id"], result.pop("asked").to_numpy(float), car.aeb)
    result["demand_mps2"] = result["brake"] * car.vehicle.full_brake_mps2(rain=0)
    return result


def kpis(signals: pd.DataFrame, failure_threshold_s: float) -> pd.DataFrame:
    """The KPIs of each test (`pipeline.core.kpi.Kpi`), by test_id."""
    names = [signal.name for signal in SIGNALS]
    rows = {
        test: asdict(
            evaluate({name: steps[name].to_numpy() for name in names}, failure_threshold_s)
        )
        for test, steps in signals.groupby("test_id", sort=False)
    }
    return pd.DataFrame.from_dict(rows, orient="index", columns=[column.name for column in KPIS])


def driven_otherwise(signals: pd.DataFrame, again: pd.DataFrame) -> list[str]:
    """test_id of each test whose brake demand differs at some time step."""
    return [
        str(test)
        for test in signals.loc[(signals["brake"] != again["brake"]).to_numpy(), "test_id"].unique()
    ]


def _judged(signals: pd.DataFrame, detections: pd.DataFrame, car: Car) -> pd.DataFrame:
    """The detections with their overlap and their outcome."""
    table = detections.merge(
        signals, on=KEY, how="left", validate="many_to_one", suffixes=("", "_signal")
    )
    found = table[list(SIDES)].to_numpy(float)
    seen, whole = (
        _overlap(found, table[[f"{kind}_{side}" for side in SIDES]].to_numpy(float))
        for kind in ("visible", "whole")
    )
    reported, matches = (
        table["score"] >= np.float32(car.criterion.threshold),
        seen > car.criterion.iou,
    )
    hidden = ~visible(table["visible_pixels"], table["contrast"]) & (
        np.maximum(seen, whole) > TOUCH_IOU
    )
    # Rows are sorted by descending score within a frame, so the first match is the best.
    first = (
        reported
        & matches
        & ~(table[KEY].assign(hit=reported & matches).groupby(KEY)["hit"].cumsum() > 1)
    )
    wrong = reported & ~hidden & ~first
    return table.assign(
        seen=seen, reported=reported, matches=matches, first=first,
        far=wrong & (seen <= TOUCH_IOU), localisation=wrong & (seen > TOUCH_IOU) & ~matches, duplicate=wrong & matches,
    )  # fmt: skip


def _per_frame(judged: pd.DataFrame, car: Car) -> dict[str, pd.Series]:
    """The signals of each frame that has detections, and the score that asks the brake, `asked`."""
    followed = judged["in_path"] if car.aeb.gate == "detections" else judged["matches"]
    asks = followed & (judged["score"] >= np.float32(car.aeb.brakes_from))
    scores = judged.assign(
        confidence=judged["score"].where(judged["first"], 0.0),
        any_confidence=judged["score"].where(judged["matches"], 0.0),
        overlap=judged["seen"].where(judged["reported"], 0.0),
        asked=judged["score"].where(asks, 0.0),
        false_positives=judged["far"].astype(int) + judged["localisation"] + judged["duplicate"],
    ).groupby(KEY)
    kinds = {
        f"false_positives_{kind}": scores[kind].sum()
        for kind in ("far", "localisation", "duplicate")
    }
    best = {
        name: scores[name].max() for name in ("confidence", "any_confidence", "overlap", "asked")
    }
    return best | kinds | {"false_positives": scores["false_positives"].sum()}


def _overlap(boxes: Floats, truth: Floats) -> Floats:
    """IoU of each box (n, 4) with the box in the same row, 0 where that is NaN."""
    width, height = (
        np.minimum(boxes[:, 2 + i], truth[:, 2 + i]) - np.maximum(boxes[:, i], truth[:, i])
        for i in (0, 1)
    )
    shared = np.clip(width, 0, None) * np.clip(height, 0, None)
    first, second = (
        np.clip(one[:, 2] - one[:, 0], 0, None) * np.clip(one[:, 3] - one[:, 1], 0, None)
        for one in (boxes, truth)
    )
    union = first + second - shared
    ratio = np.divide(shared, union, out=np.zeros(len(boxes)), where=union > 0)
    return np.asarray(np.nan_to_num(ratio, nan=0.0))


def _demand(tests: pd.Series, asked: Floats, aeb: Aeb) -> Floats:
    """Brake demand of each row from the best score that asks for it, over the frames that vote."""
    votes = (
        pd.Series(asked > 0, dtype=float)
        .groupby(tests.to_numpy())
        .rolling(aeb.window, min_periods=1)
        .sum()
        .droplevel(0)
        .sort_index()
    )
    return aeb.demand(asked, votes.to_numpy())


def with_criterion(car: Car, iou: float, threshold: float) -> Car:
    """The car with another criterion. If it braked from the old threshold on, it brakes from the new one on."""
    lowest = threshold if car.aeb.brakes_from == car.criterion.threshold else car.aeb.brakes_from
    return Car(
        car.vehicle, Aeb(**{**asdict(car.aeb), "brakes_from": lowest}), Criterion(iou, threshold)
    )
