"""The car under test, apart from its detector: what counts as a detection, when it brakes and how well."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.core.braking import Aeb, Vehicle
from pipeline.core.matching import Criterion


@dataclass(frozen=True)
class Car:
    """Everything between the detector's report and the ego's motion."""

    vehicle: Vehicle
    aeb: Aeb
    criterion: Criterion
