"""The signals of a test execution, recorded at each time step and declared once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.columns import column, columns
from pipeline.core.truth import Truth


@dataclass(frozen=True, kw_only=True)
class TimeStep:
    """One time step: a row of signals.parquet.

    Positions are in the world frame; the last step is the end, without a frame. Every KPI can be
    recomputed from the steps.
    """

    time_s: float = column("time since the start", "s")
    ego_x_m: float = column("centre of the ego", "m")
    ego_y_m: float = column("centre of the ego", "m")
    ego_heading_deg: float = column(
        "heading of the ego in degrees, 0 along x, positive to the left"
    )
    ego_speed_mps: float = column("speed of the ego", "m/s")
    pedestrian_x_m: float = column("centre of the pedestrian", "m")
    pedestrian_y_m: float = column("centre of the pedestrian", "m")
    conflict_distance_m: float = column("distance from the ego's front to the conflict point", "m")
    gap_m: float = column(
        "distance between the footprints of ego and pedestrian, 0 at a contact", "m"
    )
    on_collision_path: bool = column(
        "whether the pedestrian has not yet left the corridor that the ego sweeps"
    )
    contact: bool = column("whether the footprints touch")
    stopping_distance_m: float = column(
        "distance that the ego needs to stop under full braking, latency and build-up included", "m"
    )
    brake: float = column("brake demand that this frame causes, 0 to 1")
    demand_mps2: float = column("deceleration that the brake demands, as on a dry road", "m/s²")
    lost: bool = column("whether an earlier frame braked, and this one does not")
    confidence: float = column(
        "score of the best reported detection on the pedestrian, 0 if there is none"
    )
    any_confidence: float = column("the same over all detections, reported or not")
    overlap: float = column(
        "largest IoU of a reported detection with the visible part of the pedestrian"
    )
    ttc_s: float = column(
        "time-to-collision (Eq. 5.2); no value if it is undefined", "s", default=float("nan")
    )
    false_positives: int = column("false positives of all kinds in this frame")
    false_positives_far: int = column("false positives away from the pedestrian, IoU at most 0.1")
    false_positives_localisation: int = column(
        "false positives that fit the pedestrian poorly, IoU above 0.1 but too small to match"
    )
    false_positives_duplicate: int = column(
        "false positives on the pedestrian in addition to a better detection"
    )
    visible_pixels: int = column("visible pixels of the pedestrian", "px")
    contrast: float = column(
        "mean difference in grey levels between the pedestrian's visible pixels and their "
        "surroundings"
    )
    visible_left: float = column(
        "box around the visible part of the pedestrian; no value if there is none", "px"
    )
    visible_top: float = column(
        "box around the visible part of the pedestrian; no value if there is none", "px"
    )
    visible_right: float = column(
        "box around the visible part of the pedestrian; no value if there is none", "px"
    )
    visible_bottom: float = column(
        "box around the visible part of the pedestrian; no value if there is none", "px"
    )
    whole_left: float = column(
        "box around the part that would be visible without occluders; no value if there is none",
        "px",
    )
    whole_top: float = column(
        "box around the part that would be visible without occluders; no value if there is none",
        "px",
    )
    whole_right: float = column(
        "box around the part that would be visible without occluders; no value if there is none",
        "px",
    )
    whole_bottom: float = column(
        "box around the part that would be visible without occluders; no value if there is none",
        "px",
    )


Signals = Mapping[str, NDArray[Any]]
"""Columns of `SIGNALS` of one test execution by name, (t,) each."""
SIGNALS = columns(TimeStep)
SIDES = ("left", "top", "right", "bottom")


def box_signals(truth: Truth) -> dict[str, Any]:
    """The eight signals of the pedestrian's two boxes."""
    signals = {}
    for kind, box in (("visible", truth.visible_box), ("whole", truth.whole_box)):
        for side, value in zip(SIDES, box or (np.nan,) * 4, strict=True):
            signals[f"{kind}_{side}"] = value
    return signals


def signals_of(steps: Sequence[TimeStep]) -> dict[str, NDArray[np.generic]]:
    """The steps as (t,) arrays, one per signal."""
    rows = [vars(step) for step in steps]
    columns = {}
    for signal in SIGNALS:
        columns[signal.name] = np.array([row[signal.name] for row in rows], dtype=signal.kind)
    return columns
