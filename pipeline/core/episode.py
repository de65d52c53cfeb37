"""One test execution: its signals and its kept camera frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.core import kpi
from pipeline.core.detections import Detections
from pipeline.core.matching import Matching
from pipeline.core.signals import SIGNALS, TimeStep, signals_of
from pipeline.core.truth import Truth


@dataclass(frozen=True)
class Frame:
    """One camera frame. A detector reads `image` alone.

    Attributes:
        image: (height, width, 3) uint8 RGB.
        truth: for labels and scripted stand-ins.
        time_s: since the start of the test.
    """

    image: NDArray[np.uint8]
    truth: Truth
    time_s: float = 0.0


@dataclass(frozen=True)
class FrameDetections:
    """All detections of a frame, reported or not.

    Attributes:
        detections: n of them.
        in_path: (n,) whether the foot of each box lies in the ego's path.
    """

    detections: Detections
    in_path: NDArray[np.bool_]


@dataclass(frozen=True)
class KeptFrame:
    """A frame that was kept for training, with its detections and how they match its truth."""

    step: int
    frame: Frame
    detections: Detections
    matching: Matching


@dataclass(frozen=True)
class Episode:
    """The result of one test execution.

    Attributes:
        signals: (t,) arrays named and typed as `SIGNALS`.
        frames: the kept frames.
        detections: of each time step.
    """

    signals: Mapping[str, NDArray[np.generic]]
    frames: tuple[KeptFrame, ...] = field(default=())
    detections: tuple[FrameDetections, ...] = field(default=())

    def __post_init__(self) -> None:
        expected = {signal.name for signal in SIGNALS}
        if set(self.signals) != expected:
            raise ValueError(f"signals must be {sorted(expected)}, got {sorted(self.signals)}")
        lengths = {name: len(column) for name, column in self.signals.items()}
        if len(set(lengths.values())) != 1 or lengths["time_s"] == 0:
            raise ValueError(f"signals must have one equal length of at least 1, got {lengths}")

    @staticmethod
    def of(
        steps: Sequence[TimeStep],
        frames: Iterable[KeptFrame] = (),
        detections: Iterable[FrameDetections] = (),
    ) -> Episode:
        """The episode of these time steps; computes their TTC from the other signals (Eq. 5.2)."""
        signals = signals_of(steps)
        return Episode(signals | {"ttc_s": kpi.ttc(signals)}, tuple(frames), tuple(detections))
