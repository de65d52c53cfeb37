"""A calibrated detector keeps boxes and order; its threshold applies to calibrated scores."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.config.components import DETECTOR, component
from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.core.reliability import Calibration
from pipeline.core.truth import Truth
from pipeline.detectors.calibrated import calibrated
from pipeline.testing import check_detector

SCORES = np.array([0.9, 0.6, 0.5, 0.2, 0.1])
FRAME = Frame(np.zeros((96, 160, 3), np.uint8), Truth(None, None))


class Fixed:
    """Reports five boxes with fixed scores."""

    def __init__(self, model: str, threshold: float = 0.5) -> None:
        self.model, self.kept = model, SCORES[threshold <= SCORES]

    def detect(self, frame: Frame) -> Detections:
        boxes = np.array([[0, 0, 10 + i, 20] for i in range(len(self.kept))], np.float32).reshape(
            -1, 4
        )
        return Detections(boxes, self.kept.astype(np.float32))


def detector_with(calibration: Calibration, **settings: Any) -> Any:
    section = calibrated({"_target_": f"{__name__}.Fixed", **settings}, calibration)
    return component("detector", DETECTOR, section)(model="best.onnx")


@pytest.mark.parametrize("threshold", [0.05, 0.3, 0.55, 0.97])
@pytest.mark.parametrize(
    "calibration", [Calibration(), Calibration(2, 1), Calibration(0.5, -2), Calibration(1, 3)]
)
def test_the_threshold_counts_calibrated_scores(threshold: float, calibration: Calibration) -> None:
    expected = calibration.apply(SCORES)
    detections = detector_with(calibration, threshold=threshold).detect(FRAME)
    assert detections.scores == pytest.approx(expected[expected >= threshold])
    assert detections.boxes[:, 2].tolist() == [10 + i for i in range(len(detections.scores))]


def test_a_detector_without_a_threshold_keeps_its_own() -> None:
    detections = detector_with(Calibration(2, 1)).detect(FRAME)
    assert detections.scores == pytest.approx(Calibration(2, 1).apply([0.9, 0.6, 0.5]))


def test_it_keeps_the_contract_of_detectors() -> None:
    check_detector(detector_with(Calibration(2, 1), threshold=0.1), 160, 96)
