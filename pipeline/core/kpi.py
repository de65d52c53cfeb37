"""What a test execution is judged by: adjusted time-to-collision (thesis Eq. 5.2, 5.3) and what stands beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.core.boxes import Box, iou

Floats = NDArray[np.float64]
FailureMode = Literal["none", "contact", "late", "false_positives"]
Outcome = Literal["true_positive", "duplicate", "localisation", "far", "ignored"]
MATCH_IOU = 0.5
TOUCH_IOU = 0.1
MIN_SPEED_MPS = 0.05
MIN_VISIBLE_PIXELS = 30
MIN_CONTRAST = 8.0


@dataclass(frozen=True)
class Kpi:
    """The KPIs of one test execution, named as the columns of `tests.parquet`.

    Seconds, metres and metres per second; NaN where a thing never happened, but `adj_ttc_s` and `ttc_s` are always finite.
    """

    adj_ttc_s: float
    ttc_s: float
    failure: bool
    failure_mode: FailureMode
    contact: bool
    impact_speed_mps: float
    smallest_gap_m: float
    post_encroachment_s: float
    first_detection_s: float
    first_detection_m: float
    missed_frames: int
    false_positives: int
    false_positives_far: int
    false_positives_localisation: int
    false_positives_duplicate: int


@dataclass(frozen=True)
class Matching:
    """What became of the detections of one frame.

    outcomes: one a detection, in the order given. confidence: in [0, 1], score of the best detection that lies on the
    pedestrian (IoU > 0.5), 0 if there is none; it is the brake demand.
    """

    outcomes: tuple[Outcome, ...]
    confidence: float

    @property
    def far(self) -> int:
        return self.outcomes.count("far")

    @property
    def localisation(self) -> int:
        return self.outcomes.count("localisation")

    @property
    def duplicate(self) -> int:
        return self.outcomes.count("duplicate")

    @property
    def false_positives(self) -> int:
        """What Eq. 5.3 counts."""
        return self.far + self.localisation + self.duplicate


def barely_visible(visible_pixels: int, contrast: float) -> bool:
    """Whether a person could hardly see the pedestrian: under 30 visible pixels or under 8 grey levels of contrast."""
    return visible_pixels < MIN_VISIBLE_PIXELS or contrast < MIN_CONTRAST


def match(
    boxes: ArrayLike,
    scores: ArrayLike,
    visible_box: Box | None,
    whole_box: Box | None,
    visible_pixels: int,
    contrast: float,
) -> Matching:
    """Sort the detections of a frame with one pedestrian into true and false positives.

    boxes: (n, 4) pixels. scores: (n,) in [0, 1]. By IoU with `visible_box`: above 0.5 the best score is the true positive and
    the others are duplicates, in (0.1, 0.5] it is a localisation error, below it is far. Around a pedestrian that is barely
    visible (see `barely_visible`) a detection with IoU > 0.1 with either box is ignored, as COCO ignores crowds: it brakes,
    but is no false positive.
    """
    found = np.asarray(boxes, dtype=float).reshape(-1, 4)
    weights = np.asarray(scores, dtype=float)
    visible, whole = _overlap(found, visible_box), _overlap(found, whole_box)
    matching = np.flatnonzero(visible > MATCH_IOU)
    best = int(matching[np.argmax(weights[matching])]) if len(matching) else -1
    confidence = float(weights[best]) if len(matching) else 0.0
    hardly = barely_visible(visible_pixels, contrast)
    outcomes = [_outcome(i == best, visible[i], hardly and max(visible[i], whole[i]) > TOUCH_IOU) for i in range(len(found))]
    return Matching(tuple(outcomes), confidence)


def ttc(signals: Mapping[str, NDArray[Any]]) -> Floats:
    """Time-to-collision of each row, (t,) seconds (Eq. 5.2).

    0 at contact; otherwise conflict distance over ego speed while a collision path exists and the ego moves faster than
    0.05 m/s; NaN elsewhere.
    """
    speed = np.asarray(signals["ego_speed_mps"], dtype=float)
    distance = np.asarray(signals["conflict_distance_m"], dtype=float)
    counts = np.asarray(signals["on_collision_path"], dtype=bool) & (speed > MIN_SPEED_MPS)
    result: Floats = np.divide(distance, speed, out=np.full(len(speed), np.nan), where=counts)
    result[np.asarray(signals["contact"], dtype=bool)] = 0.0
    return result


def evaluate(signals: Mapping[str, NDArray[Any]], failure_threshold_s: float) -> Kpi:
    """Compute every KPI of one test execution from its signals (columns of `pipeline.protocols.SIGNALS`, (t,) each).

    failure_threshold_s: at or below it the adjusted TTC (Eq. 5.3) is a failure (Def. 4.10).

    If no row counts for the TTC (the paths never met while the ego moved), the first row's distance over its speed, taken as
    at least 0.05 m/s, stands for it: the KPI stays finite, and a search can still order such tests.
    """
    shortest = _shortest_ttc(signals)
    false_positives = int(np.sum(signals["false_positives"]))
    adjusted = shortest / (1 + false_positives)
    touched = np.asarray(signals["contact"], dtype=bool)
    contact = bool(touched.any())
    first_s, first_m = _first_detection(signals)
    return Kpi(
        adj_ttc_s=adjusted,
        ttc_s=shortest,
        failure=adjusted <= failure_threshold_s,
        failure_mode=_mode(contact, shortest, adjusted, failure_threshold_s),
        contact=contact,
        impact_speed_mps=float(signals["ego_speed_mps"][np.argmax(touched)]) if contact else 0.0,
        smallest_gap_m=float(np.min(signals["gap_m"])),
        post_encroachment_s=_post_encroachment(signals),
        first_detection_s=first_s,
        first_detection_m=first_m,
        missed_frames=_missed_frames(signals),
        false_positives=false_positives,
        false_positives_far=int(np.sum(signals["false_positives_far"])),
        false_positives_localisation=int(np.sum(signals["false_positives_localisation"])),
        false_positives_duplicate=int(np.sum(signals["false_positives_duplicate"])),
    )


def _overlap(boxes: Floats, box: Box | None) -> Floats:
    return np.zeros(len(boxes)) if box is None else iou(boxes, [box])[:, 0]


def _outcome(best: bool, overlap: float, ignored: bool) -> Outcome:
    if ignored:
        return "ignored"
    if best:
        return "true_positive"
    if overlap > MATCH_IOU:
        return "duplicate"
    return "localisation" if overlap > TOUCH_IOU else "far"


def _shortest_ttc(signals: Mapping[str, NDArray[Any]]) -> float:
    rows = ttc(signals)
    if np.isnan(rows).all():
        return float(signals["conflict_distance_m"][0] / max(float(signals["ego_speed_mps"][0]), MIN_SPEED_MPS))
    return float(np.nanmin(rows))


def _mode(contact: bool, shortest: float, adjusted: float, threshold: float) -> FailureMode:
    if adjusted > threshold:
        return "none"
    if contact:
        return "contact"
    return "late" if shortest <= threshold else "false_positives"


def _post_encroachment(signals: Mapping[str, NDArray[Any]]) -> float:
    """Seconds from the pedestrian having left the swept corridor to the ego's front at the conflict point.

    NaN unless both happened in this order; then there was no contact. Resolution: one row.
    """
    on_path = np.flatnonzero(signals["on_collision_path"])
    arrived = np.flatnonzero(np.asarray(signals["conflict_distance_m"]) <= 0)
    times = signals["time_s"]
    if np.any(signals["contact"]) or not len(arrived) or not len(on_path) or on_path[-1] + 1 == len(times):
        return float("nan")
    waited = float(times[arrived[0]] - times[on_path[-1] + 1])
    return waited if waited >= 0 else float("nan")


def _first_detection(signals: Mapping[str, NDArray[Any]]) -> tuple[float, float]:
    detected = np.flatnonzero(np.asarray(signals["confidence"]) > 0)
    if not len(detected):
        return float("nan"), float("nan")
    return float(signals["time_s"][detected[0]]), float(signals["conflict_distance_m"][detected[0]])


def _missed_frames(signals: Mapping[str, NDArray[Any]]) -> int:
    pixels, contrast = np.asarray(signals["visible_pixels"]), np.asarray(signals["contrast"])
    seen_by_a_person = (pixels >= MIN_VISIBLE_PIXELS) & (contrast >= MIN_CONTRAST)
    return int(np.sum(seen_by_a_person & (np.asarray(signals["confidence"]) == 0)))
