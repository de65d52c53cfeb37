"""What a car makes of a frame's detections: which are right, and how hard it brakes.

The closed loop (`pipeline.core.loop`) and the evaluation of stored tests
(`pipeline.analysis.rescoring`) share it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.braking import EmergencyBrake
from pipeline.core.car import Car
from pipeline.core.detections import Detections
from pipeline.core.matching import Matching, match
from pipeline.core.truth import Truth

NOTHING = Matching()
"""The matching of a frame without detections."""


@dataclass(frozen=True)
class Judged:
    """The judgement of one frame.

    Attributes:
        matching: how the detections fit the pedestrian.
        brake: demand, 0 to 1.
        demand_mps2: the deceleration that it demands, as on a dry road, at least 0.
        lost: whether an earlier frame braked, and this one does not.
    """

    matching: Matching = NOTHING
    brake: float = 0.0
    demand_mps2: float = 0.0
    lost: bool = False

    def signals(self) -> dict[str, Any]:
        """The signals of the frame that depend on its detections, by name."""
        matching = self.matching
        return {
            "brake": self.brake,
            "demand_mps2": self.demand_mps2,
            "lost": self.lost,
            "confidence": matching.confidence,
            "any_confidence": matching.any_confidence,
            "overlap": matching.overlap,
            "false_positives": matching.false_positives,
            "false_positives_far": matching.far,
            "false_positives_localisation": matching.localisation,
            "false_positives_duplicate": matching.duplicate,
        }


class Judge:
    """Judges the frames of one test in their order; the emergency brake remembers earlier ones."""

    def __init__(self, car: Car) -> None:
        self._car, self._brake = car, EmergencyBrake(car.aeb)
        self._has_braked = False

    def frame(self, detections: Detections, truth: Truth, in_path: NDArray[np.bool_]) -> Judged:
        """Judge the next frame.

        Args:
            detections: of the frame, reported or not.
            truth: of the frame.
            in_path: (n,) whether the foot of each box lies in the ego's path.
        """
        car = self._car
        matching = match(detections, truth, car.criterion)
        followed = in_path
        if car.aeb.gate == "truth":
            followed = np.array(matching.matches, bool)
        brake = self._brake.demand(detections, followed)
        lost = self._has_braked and brake == 0
        self._has_braked |= brake > 0
        return Judged(matching, brake, brake * car.vehicle.full_brake_mps2(rain=0), lost)
