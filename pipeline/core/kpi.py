"""KPIs of a test execution: adjusted time-to-collision (thesis Eq. 5.2, 5.3) and the measures beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.columns import column, columns
from pipeline.core.visibility import visible

Floats = NDArray[np.float64]
FailureMode = Literal["none", "contact", "late", "false_positives"]
MIN_SPEED_MPS = 0.05


@dataclass(frozen=True)
class Kpi:
    """The KPIs of one test execution, each a column of tests.parquet. `adj_ttc_s` and `ttc_s` are always finite."""

    adj_ttc_s: float = column("adjusted time-to-collision (Eq. 5.3): the smallest TTC over one plus the false positives", "s")
    ttc_s: float = column("smallest time-to-collision (Eq. 5.2)", "s")
    failure: bool = column("whether the adjusted TTC is at or below the threshold (Def. 4.10)")
    failure_mode: FailureMode = column("why it failed: contact, braking too late, or false positives alone")
    contact: bool = column("whether the ego touched the pedestrian")
    impact_speed_mps: float = column("speed of the ego at the contact, 0 without one", "m/s")
    smallest_gap_m: float = column("smallest distance between the footprints of ego and pedestrian", "m")
    post_encroachment_s: float = column(
        "from the pedestrian leaving the corridor to the ego reaching the conflict point; no value unless in this order", "s"
    )
    first_detection_s: float = column("time of the first detection of the pedestrian; no value if never", "s")
    first_detection_m: float = column("distance from the ego's front to the conflict point at the first detection; no value if never", "m")
    missed_frames: int = column("frames in which a person could see the pedestrian but no detection matches it")
    false_positives: int = column("false positives of all kinds in all frames")
    false_positives_far: int = column("false positives away from the pedestrian, IoU at most 0.1")
    false_positives_localisation: int = column("false positives that fit the pedestrian badly, IoU above 0.1 and at most 0.5")
    false_positives_duplicate: int = column("false positives on the pedestrian beside a better detection")


KPIS = columns(Kpi)
NO_KPI = Kpi(**{described.name: described.nothing for described in KPIS})
"""The KPIs of an error."""


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
    """Compute every KPI of one test execution from its signals (`pipeline.core.signals.SIGNALS`, (t,) each).

    failure_threshold_s: a test is a failure if its adjusted TTC (Eq. 5.3) is at or below it (Def. 4.10).

    If no row counts for the TTC (the paths never met while the ego moved), the first row's distance over its speed, at least 0.05 m/s,
    replaces it: the KPI stays finite, and a search can still rank such tests.
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
    """Seconds from the pedestrian leaving the swept corridor to the ego's front reaching the conflict point.

    NaN unless both happened in this order, which excludes a contact. Resolution: one row.
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
    undetected = np.asarray(signals["confidence"]) == 0
    return int(np.sum(visible(signals["visible_pixels"], signals["contrast"]) & undetected))
