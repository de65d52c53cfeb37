"""Judges stored tests again, from detections and signals, at any IoU, threshold and brake law.

It shares `pipeline.core.judge` with the closed loop: matching and brake demand exist once. What it
adds is the way from tables to frames and back. So a stored test that does not follow from its
detections has been edited, or was executed by other code.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict

import numpy as np
import pandas as pd

from pipeline.core.boxes import Box
from pipeline.core.braking import Aeb
from pipeline.core.car import Car
from pipeline.core.detections import Detections
from pipeline.core.judge import Judge, Judged
from pipeline.core.kpi import KPIS, evaluate
from pipeline.core.matching import Criterion
from pipeline.core.signals import SIDES, SIGNALS
from pipeline.core.truth import Truth
from pipeline.errors import InputError

KEY = ["test_id", "step"]


def rescored(signals: pd.DataFrame, detections: pd.DataFrame, car: Car) -> pd.DataFrame:
    """Compute everything that depends on the detections again.

    Args:
        signals: rows of signals.parquet; the rows of a test are in the order of time.
        detections: rows of detections.parquet of the same tests, by descending score in a frame.
        car: judges the detections.

    Returns:
        The signals with new judgements. The ego's motion stays as it was driven: where `brake`
        differs from the stored one, the car would have driven otherwise.

    Raises:
        InputError: for detections that no detector can report.
    """
    rows = [judged.signals() for judged in _judged(signals, detections, car)]
    fresh = pd.DataFrame(rows, index=signals.index, columns=list(Judged().signals()))
    return signals.assign(**{name: fresh[name].astype(signals[name].dtype) for name in fresh})


def kpis(signals: pd.DataFrame, failure_threshold_s: float) -> pd.DataFrame:
    """The KPIs of each test (`pipeline.core.kpi.Kpi`), by test_id."""
    names = [signal.name for signal in SIGNALS]
    rows = {}
    for test, steps in signals.groupby("test_id", sort=False):
        columns = {name: steps[name].to_numpy() for name in names}
        rows[test] = asdict(evaluate(columns, failure_threshold_s))
    return pd.DataFrame.from_dict(rows, orient="index", columns=[column.name for column in KPIS])


def driven_otherwise(signals: pd.DataFrame, again: pd.DataFrame) -> list[str]:
    """test_id of each test whose brake demand differs at some time step."""
    differs = (signals["brake"] != again["brake"]).to_numpy()
    return [str(test) for test in signals.loc[differs, "test_id"].unique()]


def with_criterion(car: Car, iou: float, threshold: float) -> Car:
    """The car with another criterion.

    If it braked from the old threshold on, it brakes from the new one on.
    """
    lowest = threshold if car.aeb.brakes_from == car.criterion.threshold else car.aeb.brakes_from
    aeb = Aeb(**{**asdict(car.aeb), "brakes_from": lowest})
    return Car(car.vehicle, aeb, Criterion(iou, threshold))


def _judged(signals: pd.DataFrame, detections: pd.DataFrame, car: Car) -> Iterator[Judged]:
    """Yield the judgement of each row."""
    judges: dict[str, Judge] = {}
    rows_of = detections.groupby(KEY).indices
    boxes = detections[list(SIDES)].to_numpy(np.float32)
    scores = detections["score"].to_numpy(np.float32)
    in_path = detections["in_path"].to_numpy(bool)
    nothing = np.zeros(0, np.int64)
    for (test, step), truth in zip(
        signals[KEY].itertuples(index=False), _truths(signals), strict=True
    ):
        rows = rows_of.get((test, step), nothing)
        try:
            reported = Detections(boxes[rows], scores[rows])
        except ValueError as error:
            raise InputError(f"detections of {test}, step {step}: {error}") from error
        judge = judges.setdefault(test, Judge(car))
        yield judge.frame(reported, truth, in_path[rows])


def _truths(signals: pd.DataFrame) -> Iterator[Truth]:
    """Yield the ground truth of each row, as far as the signals have it."""
    visible = signals[[f"visible_{side}" for side in SIDES]].to_numpy(float).tolist()
    whole = signals[[f"whole_{side}" for side in SIDES]].to_numpy(float).tolist()
    seen = signals[["visible_pixels", "contrast"]].itertuples(index=False)
    for (pixels, contrast), *corners in zip(seen, visible, whole, strict=True):
        boxes: list[Box | None] = []
        for left, top, right, bottom in corners:  # Not a number where there is no box.
            boxes.append(None if np.isnan(left) else (left, top, right, bottom))
        yield Truth(boxes[0], boxes[1], visible_pixels=pixels, contrast=contrast)
