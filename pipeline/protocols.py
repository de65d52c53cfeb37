"""The three interfaces of Blindspot: sampler, simulator and detector.

Adapters (MuJoCo, ONNX Runtime, your own) implement these protocols; `pipeline.testing` provides a checker for each. This module needs only
numpy.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from pipeline.core.detections import Detections
from pipeline.core.episode import Episode, Frame
from pipeline.core.space import Floats, Value

Admitted = tuple[float, float] | tuple[str, ...]
"""What a simulator admits of a variable: lowest and highest number, or names; anything if empty."""


@runtime_checkable
class Detector(Protocol):
    """A system under test: finds pedestrians in one camera frame."""

    def detect(self, frame: Frame) -> Detections:
        """Return the pedestrians in `frame.image` with scores at or above the detector's own threshold."""
        ...


@runtime_checkable
class Simulator(Protocol):
    """Executes concrete scenarios of one functional scenario in closed loop.

    A test execution depends only on the concrete scenario and the detector: repeating it gives identical results to the last bit, in any
    order and any process. A simulator that cannot execute a scenario raises `SimulationError`.

    A class may declare `needs`, a mapping from the variables that a scenario must have to what it admits of each (`Admitted`). A study that
    does not meet it is refused before anything runs, and, if the class declares `closed` as True, one with any other variable, too.
    """

    def execute(
        self,
        concrete: Mapping[str, Value],
        detector: Detector,
        keep_every: int = 0,
        noise: Mapping[str, Value] | None = None,
    ) -> Episode:
        """Execute one concrete scenario; keep every `keep_every`-th frame, none if it is 0.

        noise: the concrete scenario whose random numbers it has, such as the camera's grain; its own if None. Further keys change them.
        """
        ...


@runtime_checkable
class Sampler(Protocol):
    """A test strategy by ask and tell. Its state is its history: telling the same rows again restores it.

    Points are (n, d) float64 in the encoding of `pipeline.core.space.Space`: categorical variables by index.
    """

    def ask(self) -> Floats:
        """Return the next batch of untested points, (b, d); none, (0, d), ends the campaign."""
        ...

    def tell(self, points: Floats, kpi: Floats) -> None:
        """Record the KPI of the asked points, (b, d) and (b,); NaN for an error. At or below the threshold, a test has failed."""
        ...
