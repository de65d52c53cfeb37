"""KPIs of a test: adjusted time-to-collision (thesis Eq. 5.2, 5.3) and further measures."""

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
    """The KPIs of one test execution, each a column of tests.parquet.

    `adj_ttc_s` and `ttc_s` are always finite.
    """

    adj_ttc_s: float = column(
        "adjusted time-to-collision (Eq. 5.3): the smallest TTC over one plus the false positives",
        "s",
    )
    ttc_s: float = column("smallest time-to-collision (Eq. 5.2)", "s")
    adj_ttc_per_frame_s: float = column(
        "smallest TTC over one plus the false positives of an average frame", "s"
    )
    failure: bool = column(
        "whether the adjusted TTC is at or below the threshold (Def. 4.10); without collision path "
        "and contact, any false activation"
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
        "time from the pedestrian leaving the corridor to the ego reaching the conflict point, "
        "if need be at its last speed; no value in any other order or if the ego stops",
        "s",
    )
    first_detection_s: float = column(
        "time of the first detection of the pedestrian; no value if never", "s"
    )
    first_detection_m: float = column(
        "distance from the ego's front to the conflict point at the first detection; "
        "no value if never",
        "m",
    )
    false_activations: int = column(
        "unnecessary emergency braking: runs of frames that demand at least 5 m/s² "
        "without a collision path"
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
    """Time-to-collision of each row (Eq. 5.2).

    Args:
        signals: of one test.

    Returns:
        (t,) seconds: 0 at contact; otherwise conflict distance over ego speed while a collision
        path exists and the ego moves faster than 0.05 m/s; NaN elsewhere.

    >>> ttc({
    ...     "ego_speed_mps": [10.0, 10.0, 8.0],
    ...     "conflict_distance_m": [20.0, 10.0, 0.0],
    ...     "on_collision_path": [False, True, True],
    ...     "contact": [False, False, True],
    ... })
    array([nan,  1.,  0.])
    """
    speed = np.asarray(signals["ego_speed_mps"], dtype=float)
    distance = np.asarray(signals["conflict_distance_m"], dtype=float)
    counts = np.asarray(signals["on_collision_path"], dtype=bool) & (speed > MIN_SPEED_MPS)
    result: Floats = np.divide(distance, speed, out=np.full(len(speed), np.nan), where=counts)
    result[np.asarray(signals["contact"], dtype=bool)] = 0.0
    return result


def running_adj_ttc(signals: Signals) -> Floats:
    """Adjusted TTC of each row, (t,) seconds; NaN where TTC is undefined.

    It is the row's TTC, divided by one plus the false positives up to it.
    """
    return np.asarray(ttc(signals) / (1 + np.cumsum(signals["false_positives"])))


def evaluate(signals: Signals, failure_threshold_s: float) -> Kpi:
    """Compute every KPI of one test execution.

    If no row counts for the TTC (the paths never met while the ego moved), the first row's distance
    over its speed, at least 0.05 m/s, replaces it: the KPI stays finite, and a search can still
    rank such tests.

    Args:
        signals: of the test.
        failure_threshold_s: a test is a failure if its adjusted TTC (Eq. 5.3) is at or below it
            (Def. 4.10). A test in which no collision path ever exists asks the ego not to brake: it
            is a failure if there is a false activation.

    >>> from pipeline.core.loop import run_test
    >>> from pipeline.detectors.scripted import BlindDetector
    >>> from pipeline.simulators.analytic import AnalyticWorld
    >>> from pipeline.testing import CAR
    >>> weather = {"rain": 0.0, "fog": 10.0, "sun_altitude": 45.0}
    >>> concrete = {**weather, "pedestrian_speed": 1.5, "animation": "walking"}
    >>> episode = run_test(AnalyticWorld(), BlindDetector(), CAR, concrete)
    >>> kpi = evaluate(episode.signals, failure_threshold_s=0.1)
    >>> kpi.failure_mode, kpi.impact_speed_mps
    ('contact', 10.0)
    """
    shortest, touched = _shortest_ttc(signals), np.asarray(signals["contact"], dtype=bool)
    false_positives = int(np.sum(signals["false_positives"]))
    per_frame = false_positives / max(1, len(touched) - 1)  # The last row has no frame.
    adjusted, contact = shortest / (1 + false_positives), bool(touched.any())
    activations = _false_activations(signals)
    mode = _mode(signals, contact, shortest, adjusted, failure_threshold_s)
    undetected = np.asarray(signals["confidence"]) == 0
    missed = visible(signals["visible_pixels"], signals["contrast"]) & undetected
    first_s = first_m = float("nan")
    if not undetected.all():
        first = int(np.argmin(undetected))
        first_s, first_m = (
            float(signals[name][first]) for name in ("time_s", "conflict_distance_m")
        )
    # Speed lost between rows without a collision path.
    speed = np.asarray(signals["ego_speed_mps"], dtype=float)
    off = ~np.asarray(signals["on_collision_path"], dtype=bool)
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
        speed_loss_mps=float(np.sum(np.maximum(0, -np.diff(speed)), where=off[:-1] & off[1:])),
        missed_frames=int(np.sum(missed)),
        false_positives=false_positives,
        false_positives_per_frame=per_frame,
        false_positives_far=int(np.sum(signals["false_positives_far"])),
        false_positives_localisation=int(np.sum(signals["false_positives_localisation"])),
        false_positives_duplicate=int(np.sum(signals["false_positives_duplicate"])),
    )


def told(adj_ttc_s: Floats, failure: ArrayLike, failure_threshold_s: float) -> Floats:
    """What a strategy learns of tests: the adjusted TTC, moved across the threshold if need be.

    It lies above the threshold exactly for the tests that did not fail. Without a collision path, a
    false activation decides, whatever the adjusted TTC. At or below the threshold, a strategy
    treats a test as a failure.

    Args:
        adj_ttc_s: (n,) seconds, NaN for none.
        failure: (n,) whether each test failed.
        failure_threshold_s: seconds.

    >>> told(np.array([0.05, 3.0, 3.0]), [True, True, False], 0.1)
    array([0.05, 0.1 , 3.  ])
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
        speed = max(float(signals["ego_speed_mps"][0]), MIN_SPEED_MPS)
        return float(signals["conflict_distance_m"][0] / speed)
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
    """Seconds of each run of rows that demand emergency braking without a collision path."""
    off = ~np.asarray(signals["on_collision_path"], dtype=bool)
    wrong = (np.asarray(signals["demand_mps2"]) >= EMERGENCY_MPS2) & off
    edges = np.diff(np.concatenate([[0], wrong.astype(int), [0]]))
    times = np.append(signals["time_s"], signals["time_s"][-1])
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [float(seconds) for seconds in times[ends] - times[starts]]


def _post_encroachment(signals: Signals) -> float:
    """Seconds from the pedestrian leaving the corridor to the ego's front at the conflict point.

    A test may end before the ego arrives; it is then taken to keep its last speed. NaN unless both
    happen in this order, which excludes a contact and an ego that has stopped. Resolution: one
    row.
    """
    nothing, times = float("nan"), signals["time_s"]
    on_path = np.flatnonzero(signals["on_collision_path"])
    if np.any(signals["contact"]) or not len(on_path) or on_path[-1] + 1 == len(times):
        return nothing
    left = float(times[on_path[-1] + 1])
    distance = np.asarray(signals["conflict_distance_m"], dtype=float)
    speed = float(signals["ego_speed_mps"][-1])
    arrived = np.flatnonzero(distance <= 0)
    if len(arrived):
        arrival = float(times[arrived[0]])
    elif speed > MIN_SPEED_MPS:
        arrival = float(times[-1] + distance[-1] / speed)
    else:
        return nothing
    return arrival - left if arrival >= left else nothing
