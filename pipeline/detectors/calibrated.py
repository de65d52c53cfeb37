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

    Args:
        detector: the config section of the other detector.
        slope, offset: of the calibration.
        model: file or folder of the other detector.
        threshold: smallest calibrated score reported, as for detectors whose files hold their
            calibration; None leaves the other detector's.
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
        settings: dict[str, Any] = {"model": model}
        if threshold is not None:
            settings["threshold"] = float(self._calibration.undo(threshold))
        self._detector: Detector = component("detector", DETECTOR, detector)(**settings)

    def detect(self, frame: Frame) -> Detections:
        """Return the pedestrians in the image, with calibrated scores."""
        raw = self._detector.detect(frame)
        return Detections(raw.boxes, self._calibration.apply(raw.scores).astype(np.float32))


def calibrated(section: Mapping[str, Any], calibration: Calibration) -> dict[str, Any]:
    """The config section of a detector with calibrated scores.

    Args:
        section: of the detector without calibration.
        calibration: of its scores.
    """
    target = f"{CalibratedDetector.__module__}.{CalibratedDetector.__qualname__}"
    threshold = {"threshold": section["threshold"]} if "threshold" in section else {}
    scaling = {"slope": calibration.slope, "offset": calibration.offset}
    return {"_target_": target, "detector": dict(section), **scaling, **threshold}


def as_tested(
    section: Mapping[str, Any], calibration: DetectorCalibration | None
) -> dict[str, Any]:
    """The config section of a version's detector as its tests use it.

    Args:
        section: of the detector without calibration.
        calibration: of the version, if the study calibrates it.
    """
    return dict(section) if calibration is None else calibrated(section, calibration.scaling)
