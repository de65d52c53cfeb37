"""The car under test, apart from its detector."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.core.braking import Aeb, Vehicle
from pipeline.core.matching import Criterion


@dataclass(frozen=True)
class Car:
    """Everything between the detector's report and the ego's motion.

    Attributes:
        vehicle: how well it brakes.
        aeb: when it brakes.
        criterion: what counts as a detection.
    """

    vehicle: Vehicle
    aeb: Aeb
    criterion: Criterion
