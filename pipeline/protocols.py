"""The three seams of Blindspot: what a sampler, a simulator and a detector must offer.

Adapters (MuJoCo, ONNX Runtime, a customer's own) implement these protocols; `pipeline.testing` ships a checker for each.
Only numpy is needed to read this file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]
Value = float | str
"""A scenario variable's value: a number in the variable's unit, or the name of a category."""

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
class Detections:
    """Pedestrians that a detector reports in one image, best first.

    boxes: (n, 4) float32, pixels, left, top, right, bottom. scores: (n,) float32 in [0, 1], descending.
    """

    boxes: NDArray[np.float32]
    scores: NDArray[np.float32]

    def __post_init__(self) -> None:
        if self.boxes.ndim != 2 or self.boxes.shape[1] != 4:
            raise ValueError(f"boxes must have shape (n, 4), got {self.boxes.shape}")
        if self.scores.shape != (len(self.boxes),):
            raise ValueError(f"scores must have shape ({len(self.boxes)},), got {self.scores.shape}")
        if len(self.scores) and not (float(self.scores.min()) >= 0 and float(self.scores.max()) <= 1):
            raise ValueError(f"scores must be in [0, 1], got {self.scores.min()} to {self.scores.max()}")
        if (np.diff(self.scores) > 0).any():
            raise ValueError("scores must descend")

    @staticmethod
    def none() -> Detections:
        return Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32))


@dataclass(frozen=True)
class Truth:
    """Ground truth of the one pedestrian of a frame.

    Boxes are left, top, right, bottom in pixels; None where no pixel shows. `whole` is what would show without
    occluders. contrast: mean absolute grey-level difference between its visible pixels and the ring around its box.
    """

    visible_box: Box | None = None
    whole_box: Box | None = None
    visible_pixels: int = 0
    whole_pixels: int = 0
    contrast: float = 0.0


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


@runtime_checkable
class Detector(Protocol):
    """A system under test: finds pedestrians in one camera frame."""

    def detect(self, frame: Frame) -> Detections:
        """Return the pedestrians in `frame.image` whose score reaches the detector's own threshold."""
        ...


@runtime_checkable
class Simulator(Protocol):
    """Executes concrete scenarios of one functional scenario in closed loop.

    A test execution is a function of the concrete scenario and the detector alone: the same two give the same bits, in any
    order and any process. A simulator that cannot execute a scenario raises `SimulationError`.
    """

    def execute(self, concrete: Mapping[str, Value], detector: Detector, keep_every: int = 0) -> Episode:
        """Execute one concrete scenario; keep every `keep_every`-th frame, none if it is 0."""
        ...


@runtime_checkable
class Sampler(Protocol):
    """A test strategy by ask and tell. Its state is its history: telling the same rows again restores it.

    Points are (n, d) float64 in the encoding of `pipeline.core.space.Space`: categorical variables by index.
    """

    def ask(self) -> Floats:
        """Return the next batch of untested points, (b, d)."""
        ...

    def tell(self, points: Floats, kpi: Floats) -> None:
        """Take the KPI of the asked points, (b, d) and (b,); NaN where the simulation broke."""
        ...


class SimulationError(RuntimeError):
    """The simulation broke. An outcome of its own, never a KPI."""


class InputError(ValueError):
    """Bad input from outside (a key, a file, a machine); its one message says what to do. The command line exits with 2."""
