"""A detector with calibrated scores, for detectors whose files hold no calibration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.config.components import DETECTOR, component
from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.core.reliability import Calibration
from pipeline.protocols import Detector


class CalibratedDetector:
    """Runs another detector and calibrates its scores; boxes and their order stay the same.

    detector: the section of the other detector. slope, offset: of the calibration.
    threshold: smallest calibrated score reported, as for detectors whose files hold their calibration.
    """

    def __init__(
        self,
        detector: dict[str, Any],
        slope: float,
        offset: float,
        model: str,
        threshold: float | None = None,
    ) -> None:
        self._calibration = Calibration(slope, offset)
        lowest = (
            {} if threshold is None else {"threshold": float(self._calibration.undo(threshold))}
        )
        self._detector: Detector = component("detector", DETECTOR, detector)(model=model, **lowest)

    def detect(self, frame: Frame) -> Detections:
        """Return the pedestrians in the image, with calibrated scores."""
        found = self._detector.detect(frame)
        return Detections(found.boxes, self._calibration.apply(found.scores).astype(np.float32))


def calibrated(section: Mapping[str, Any], calibration: Calibration) -> dict[str, Any]:
    """The section of a detector with calibrated scores. section: of the detector itself."""
    target = f"{CalibratedDetector.__module__}.{CalibratedDetector.__qualname__}"
    threshold = {"threshold": section["threshold"]} if "threshold" in section else {}
    scaling = {"slope": calibration.slope, "offset": calibration.offset}
    return {"_target_": target, "detector": dict(section), **scaling, **threshold}


def as_tested(
    section: Mapping[str, Any], calibration: DetectorCalibration | None
) -> dict[str, Any]:
    """The section of a version's detector as its tests have it. calibration: of the version, if the study calibrates it."""
    return dict(section) if calibration is None else calibrated(section, calibration.scaling)
