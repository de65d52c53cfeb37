"""Scripted stand-ins that read the ground truth.

They test whether the world is fair, not how good a detector is.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.detections import Detections
from pipeline.core.episode import Frame

FOOT, STATURE, BREADTH = 0.117, 0.147, 0.048
"""Of a person 1.70 m tall and 0.55 m wide, 10 m ahead, from a height of 1.35 m.

Foot below the middle of the image, height and width, as shares of the image's width."""


class _Scripted:
    """A detector that reads no file; model: ignored, so that it can replace one that does."""

    def __init__(self, model: str | None = None) -> None:
        pass


class VisiblePixelOracle(_Scripted):
    """Sees the pedestrian once it is `pipeline.core.visibility.visible`, as an attentive person."""

    def detect(self, frame: Frame) -> Detections:
        """The visible box with score 1, or nothing."""
        truth = frame.truth
        if truth.visible_box is None or truth.barely_visible:
            return Detections.none()
        return Detections(np.array([truth.visible_box], np.float32), np.ones(1, np.float32))


class EverywhereDetector(_Scripted):
    """Reports the same person with score 1 in every image.

    The person stands 10 m ahead of a camera of 60 degrees. It shows that a detector does not pass
    by always braking.
    """

    def detect(self, frame: Frame) -> Detections:
        """The same box in every image."""
        height, width = frame.image.shape[:2]
        foot = height / 2 + FOOT * width
        left, right = (0.5 - BREADTH / 2) * width, (0.5 + BREADTH / 2) * width
        box = [left, foot - STATURE * width, right, foot]
        return Detections(np.array([box], np.float32), np.ones(1, np.float32))


class BlindDetector(_Scripted):
    """Sees nothing; the ego never brakes."""

    def detect(self, frame: Frame) -> Detections:
        """Nothing."""
        return Detections.none()
