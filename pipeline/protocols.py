"""The three seams of Blindspot: what a sampler, a simulator and a detector must offer.

Adapters (MuJoCo, ONNX Runtime, your own) implement these protocols; `pipeline.testing` ships a checker for each.
Only numpy is needed to read this file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from pipeline.core.detections import Detections
from pipeline.core.episode import Episode, Frame
from pipeline.core.space import Floats, Value


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
