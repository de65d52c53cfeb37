"""One test execution: its signals, and the camera frames that were kept of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.core.detections import Detections
from pipeline.core.truth import Truth

SIGNALS: Mapping[str, type] = {
    "time_s": np.float64,
    "ego_x_m": np.float64,
    "ego_y_m": np.float64,
    "ego_heading_deg": np.float64,
    "ego_speed_mps": np.float64,
    "pedestrian_x_m": np.float64,
    "pedestrian_y_m": np.float64,
    "conflict_distance_m": np.float64,
    "gap_m": np.float64,
    "on_collision_path": np.bool_,
    "contact": np.bool_,
    "brake": np.float64,
    "confidence": np.float64,
    "ttc_s": np.float64,
    "false_positives": np.int64,
    "false_positives_far": np.int64,
    "false_positives_localisation": np.int64,
    "false_positives_duplicate": np.int64,
    "visible_pixels": np.int64,
    "contrast": np.float64,
}
"""Columns of `Episode.signals`, one value a time step; every KPI can be computed from them again."""


@dataclass(frozen=True)
class Frame:
    """One camera frame. image: (height, width, 3) uint8 RGB.

    A detector looks at `image` alone; `truth` is there for scripted stand-ins and for labels.
    """

    image: NDArray[np.uint8]
    truth: Truth
    time_s: float = 0.0


@dataclass(frozen=True)
class KeptFrame:
    """A frame of a test execution that was kept for training, with what the detector said of it."""

    step: int
    frame: Frame
    detections: Detections


@dataclass(frozen=True)
class Episode:
    """What one test execution left behind: (t,) arrays named and typed as `SIGNALS`, and the kept frames."""

    signals: Mapping[str, NDArray[np.generic]]
    frames: tuple[KeptFrame, ...] = field(default=())

    def __post_init__(self) -> None:
        if set(self.signals) != set(SIGNALS):
            raise ValueError(f"signals must be {sorted(SIGNALS)}, got {sorted(self.signals)}")
        lengths = {name: len(column) for name, column in self.signals.items()}
        if len(set(lengths.values())) != 1 or lengths["time_s"] == 0:
            raise ValueError(f"signals must have one equal length of at least 1, got {lengths}")
