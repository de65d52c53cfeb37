"""KPIs of a test execution: adjusted time-to-collision (thesis Eq. 5.2, 5.3) and further measures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.core.braking import EMERGENCY_MPS2
from pipeline.core.causes import Cause, cause
from pipeline.core.columns import column, columns
from pipeline.core.signals import Signals
from pipeline.core.visibility import visible

Floats = NDArray[np.float64]
FailureMode = Literal["none", "contact", "late", "false_positives", "false_activation"]
MIN_SPEED_MPS = 0.05


@dataclass(frozen=True)
class Kpi:
    """The KPIs of one test execution, each a column of tests.parquet. `adj_ttc_s` and `ttc_s` are always finite."""

    adj_ttc_s: float = column(
        "adjusted time-to-collision (Eq. 5.3): the smallest TTC over one plus the false positives",
        "s",
    )
    ttc_s: float = column("smallest time-to-collision (Eq. 5.2)", "s")
    adj_ttc_per_frame_s: float = column(
        "smallest TTC over one plus the false positives of an average frame", "s"
    )
    failure: bool = column(
        "whether the adjusted TTC is at or below the threshold (Def. 4.10); without collision path and contact, any false activation"
    )
    failure_mode: FailureMode = column(
        "how it failed; `false_positives` means by false positives alone"
    )
    cause: Cause = column("why it failed; see `pipeline.core.causes`")
    contact: bool = column("whether the ego touched the pedestrian")
    impact_speed_mps: float = column("speed of the ego at contact, 0 without contact", "m/s")
    smallest_gap_m: float = column(
        "smallest distance between the footprints of ego and pedestrian", "m"
    )
    post_encroachment_s: float = column(
        "time from the pedestrian leaving the corridor to the ego reaching the conflict point, if need be at its last speed; no value in "
        "any other order or if the ego stops",
        "s",
    )
    first_detection_s: float = column(
        "time of the first detection of the pedestrian; no value if never", "s"
    )
    first_detection_m: float = column(
        "distance from the ego's front to the conflict point at the first detection; no value if never",
        "m",
    )
    false_activations: int = column(
        "unnecessary emergency braking: runs of frames that demand at least 5 m/s² without a collision path"
    )
    false_activation_s: float = column("total duration of the false activations", "s")
    speed_loss_mps: float = column("speed lost by unnecessary braking", "m/s")
    missed_frames: int = column(
        "frames in which a person could see the pedestrian but no detection matches it"
    )
    false_positives: int = column("false positives of all kinds in all frames")
    false_positives_per_frame: float = column(
        "the same, divided by the number of frames: independent of duration and frame rate"
    )
    false_positives_far: int = column("false positives away from the pedestrian, IoU at most 0.1")
    false_positives_localisation: int = column(
        "false positives that fit the pedestrian poorly, IoU above 0.1 but too small to match"
    )
    false_positives_duplicate: int = column(
        "false positives on the pedestrian in addition to a better detection"
    )


KPIS = columns(Kpi)
NO_KPI = Kpi(**{described.name: described.nothing for described in KPIS})
"""The KPIs of an error."""


def ttc(signals: Signals) -> Floats:
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


def running_adj_ttc(signals: Signals) -> Floats:
    """Adjusted TTC of each row, (t,) seconds: its TTC, divided by one plus the false positives up to it; NaN where TTC is undefined."""
    return np.asarray(ttc(signals) / (1 + np.cumsum(signals["false_positives"])))


def evaluate(signals: Signals, failure_threshold_s: float) -> Kpi:
    """Compute every KPI of one test execution from its signals.

    failure_threshold_s: a test is a failure if its adjusted TTC (Eq. 5.3) is at or below it (Def. 4.10). A test in which no collision path
    ever exists asks the ego not to brake: it is a failure if there is a false activation.

    If no row counts for the TTC (the paths never met while the ego moved), the first row's distance over its speed, at least 0.05 m/s,
    replaces it: the KPI stays finite, and a search can still rank such tests.
    """
    shortest, touched = _shortest_ttc(signals), np.asarray(signals["contact"], dtype=bool)
    false_positives = int(np.sum(signals["false_positives"]))
    per_frame = false_positives / max(1, len(touched) - 1)  # The last row has no frame.
    adjusted, contact = shortest / (1 + false_positives), bool(touched.any())
    activations = _false_activations(signals)
    mode = _mode(signals, contact, shortest, adjusted, failure_threshold_s)
    first_s, first_m = _first_detection(signals)
    return Kpi(
        adj_ttc_s=adjusted,
        ttc_s=shortest,
        adj_ttc_per_frame_s=shortest / (1 + per_frame),
        failure=mode != "none",
        failure_mode=mode,
        cause=cause(signals, mode),
        contact=contact,
        impact_speed_mps=float(signals["ego_speed_mps"][np.argmax(touched)]) if contact else 0.0,
        smallest_gap_m=float(np.min(signals["gap_m"])),
        post_encroachment_s=_post_encroachment(signals),
        first_detection_s=first_s,
        first_detection_m=first_m,
        false_activations=len(activations),
        false_activation_s=float(sum(activations)),
        speed_loss_mps=_speed_loss(signals),
        missed_frames=_missed_frames(signals),
        false_positives=false_positives,
        false_positives_per_frame=per_frame,
        false_positives_far=int(np.sum(signals["false_positives_far"])),
        false_positives_localisation=int(np.sum(signals["false_positives_localisation"])),
        false_positives_duplicate=int(np.sum(signals["false_positives_duplicate"])),
    )


def told(adj_ttc_s: Floats, failure: ArrayLike, failure_threshold_s: float) -> Floats:
    """What a strategy learns of (n,) tests: the adjusted TTC, NaN without one, moved across the threshold where it contradicts `failure`.

    Without a collision path, a false activation decides, whatever the adjusted TTC. At or below the threshold, a strategy takes a test for
    a failure.
    """
    beyond = np.nextafter(failure_threshold_s, np.inf)
    return np.where(
        np.asarray(failure, dtype=bool),
        np.minimum(adj_ttc_s, failure_threshold_s),
        np.maximum(adj_ttc_s, beyond),
    )


def asks_to_brake(signals: Signals) -> bool:
    """Whether a collision path exists at any time, so that braking is right."""
    return bool(np.any(signals["on_collision_path"]))


def _shortest_ttc(signals: Signals) -> float:
    rows = ttc(signals)
    if np.isnan(rows).all():
        return float(
            signals["conflict_distance_m"][0]
            / max(float(signals["ego_speed_mps"][0]), MIN_SPEED_MPS)
        )
    return float(np.nanmin(rows))


def _mode(
    signals: Signals, contact: bool, shortest: float, adjusted: float, threshold: float
) -> FailureMode:
    if not asks_to_brake(signals) and not contact:
        return "false_activation" if _false_activations(signals) else "none"
    if adjusted > threshold:
        return "none"
    if contact:
        return "contact"
    return "late" if shortest <= threshold else "false_positives"


def _false_activations(signals: Signals) -> list[float]:
    """Seconds of each run of rows that demand emergency braking although no collision path exists."""
    wrong = (np.asarray(signals["demand_mps2"]) >= EMERGENCY_MPS2) & ~np.asarray(
        signals["on_collision_path"], dtype=bool
    )
    edges = np.diff(np.concatenate([[0], wrong.astype(int), [0]]))
    times = np.append(signals["time_s"], signals["time_s"][-1])
    return [
        float(times[end] - times[start])
        for start, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True)
    ]


def _speed_loss(signals: Signals) -> float:
    """Speed lost between rows without a collision path."""
    speed, off = (
        np.asarray(signals["ego_speed_mps"], dtype=float),
        ~np.asarray(signals["on_collision_path"], dtype=bool),
    )
    return float(np.sum(np.maximum(0, -np.diff(speed)), where=off[:-1] & off[1:]))


def _post_encroachment(signals: Signals) -> float:
    """Seconds from the pedestrian leaving the swept corridor to the ego's front reaching the conflict point.

    A test may end before the ego arrives; it is then taken to keep its last speed. NaN unless both happen in this order, which excludes a
    contact, and an ego that has stopped. Resolution: one row.
    """
    on_path, times = np.flatnonzero(signals["on_collision_path"]), signals["time_s"]
    distance, speed = (
        np.asarray(signals["conflict_distance_m"], dtype=float),
        float(signals["ego_speed_mps"][-1]),
    )
    arrived = np.flatnonzero(distance <= 0)
    if (
        np.any(signals["contact"])
        or not len(on_path)
        or on_path[-1] + 1 == len(times)
        or not (len(arrived) or speed > MIN_SPEED_MPS)
    ):
        return float("nan")
    arrival = float(times[arrived[0]]) if len(arrived) else float(times[-1] + distance[-1] / speed)
    waited = arrival - float(times[on_path[-1] + 1])
    return waited if waited >= 0 else float("nan")


def _first_detection(signals: Signals) -> tuple[float, float]:
    detected = np.flatnonzero(np.asarray(signals["confidence"]) > 0)
    if not len(detected):
        return float("nan"), float("nan")
    return float(signals["time_s"][detected[0]]), float(signals["conflict_distance_m"][detected[0]])


def _missed_frames(signals: Signals) -> int:
    undetected = np.asarray(signals["confidence"]) == 0
    return int(np.sum(visible(signals["visible_pixels"], signals["contrast"]) & undetected))
