"""Scripted stand-ins that read the ground truth: they test whether the world is fair, not how good a detector is."""

from __future__ import annotations

import numpy as np

from pipeline.core.detections import Detections
from pipeline.core.episode import Frame


class VisiblePixelOracle:
    """Stands in for an attentive person: sees the pedestrian once enough of its pixels are visible with enough contrast.

    min_pixels: visible pixels. min_contrast: grey levels. model: ignored, so that it can replace a detector that reads a file.
    """

    def __init__(self, min_pixels: int = 30, min_contrast: float = 6.0, model: str | None = None) -> None:
        self._min_pixels, self._min_contrast = min_pixels, min_contrast

    def detect(self, frame: Frame) -> Detections:
        """The visible box with score 1, or nothing."""
        truth = frame.truth
        if truth.visible_box is None or truth.visible_pixels < self._min_pixels or truth.contrast < self._min_contrast:
            return Detections.none()
        return Detections(np.array([truth.visible_box], np.float32), np.ones(1, np.float32))


class BlindDetector:
    """Sees nothing; the ego never brakes."""

    def __init__(self, model: str | None = None) -> None:
        pass

    def detect(self, frame: Frame) -> Detections:
        """Nothing."""
        return Detections.none()
