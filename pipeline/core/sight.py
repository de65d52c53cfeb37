"""What the camera saw of the pedestrian in a test, and when the detector first found it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.columns import column, columns
from pipeline.core.signals import Signals
from pipeline.core.visibility import visible

NAN = float("nan")


@dataclass(frozen=True)
class Sight:
    """The moments of first sight, last chance and first detection; no value for what never comes.

    First sight: the first frame in which a person could make out the pedestrian, see
    `pipeline.core.visibility.visible`. Last chance: the last frame from which full braking would
    still have stopped the ego before the conflict point. Distances are from the ego's front to the
    conflict point.
    """

    first_sight_s: float = column(
        "time at which a person could first make out the pedestrian; no value if never",
        "s",
        default=NAN,
    )
    first_sight_m: float = column("distance to the conflict point at first sight", "m", default=NAN)
    first_sight_pixels: float = column(
        "visible pixels of the pedestrian at first sight", "px", default=NAN
    )
    first_sight_contrast: float = column(
        "contrast of the pedestrian at first sight, grey levels", default=NAN
    )
    last_chance_s: float = column(
        "time of the last frame from which full braking still helps; no value if none",
        "s",
        default=NAN,
    )
    last_chance_pixels: float = column(
        "visible pixels of the pedestrian at the last chance", "px", default=NAN
    )
    last_chance_contrast: float = column(
        "contrast of the pedestrian at the last chance, grey levels", default=NAN
    )
    first_detection_s: float = column(
        "time of the first detection of the pedestrian; no value if never", "s", default=NAN
    )
    first_detection_m: float = column(
        "distance to the conflict point at the first detection", "m", default=NAN
    )


SIGHT = columns(Sight)


def sight(signals: Signals) -> Sight:
    """What the camera saw in a test. The last row has no frame, so it is no last chance."""
    seen = _first(visible(signals["visible_pixels"], signals["contrast"]))
    detected = _first(np.asarray(signals["confidence"]) > 0)
    left_m, needed_m = (
        np.asarray(signals[f"{kind}_distance_m"][:-1]) for kind in ("conflict", "stopping")
    )
    in_time = np.flatnonzero(left_m > needed_m)
    last = int(in_time[-1]) if len(in_time) else None
    return Sight(
        first_sight_s=_at(signals, "time_s", seen),
        first_sight_m=_at(signals, "conflict_distance_m", seen),
        first_sight_pixels=_at(signals, "visible_pixels", seen),
        first_sight_contrast=_at(signals, "contrast", seen),
        last_chance_s=_at(signals, "time_s", last),
        last_chance_pixels=_at(signals, "visible_pixels", last),
        last_chance_contrast=_at(signals, "contrast", last),
        first_detection_s=_at(signals, "time_s", detected),
        first_detection_m=_at(signals, "conflict_distance_m", detected),
    )


def _first(holds: NDArray[np.bool_]) -> int | None:
    return int(np.argmax(holds)) if holds.any() else None


def _at(signals: Signals, name: str, step: int | None) -> float:
    return NAN if step is None else float(signals[name][step])
