"""Any Python function as a detector."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.detectors.suppression import check_thresholds, inside, reported
from pipeline.errors import InputError, SimulationError


class FunctionDetector:
    """Finds pedestrians with a function `image -> (boxes, scores)`.

    function: its dotted name. It takes (h, w, 3) uint8 RGB and returns (n, 4) left, top, right, bottom in pixels and (n,) in [0, 1], in any
    order. threshold, iou: as for `OnnxDetector`. model: ignored, so that it can replace a detector that reads a file.

    InputError if there is no such function. Any exception in it, and any result of another shape, becomes a SimulationError.
    """

    def __init__(self, function: str, threshold: float = 0.5, iou: float = 0.45, model: str | None = None) -> None:
        check_thresholds(threshold, iou)
        module, _, name = function.rpartition(".")
        try:
            self._function: Any = getattr(import_module(module), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise InputError(f"detector.function: there is no '{function}' ({error})") from error
        if not callable(self._function):
            raise InputError(f"detector.function: expected a function, got {function} of type {type(self._function).__name__}")
        self._name, self._threshold, self._iou = function, threshold, iou

    def detect(self, frame: Frame) -> Detections:
        """Return the pedestrians in the image."""
        try:
            boxes, scores = (np.asarray(part, np.float32) for part in self._function(frame.image.copy()))
        except Exception as error:  # Foreign code may raise anything; the campaign must continue.
            raise SimulationError(f"{self._name} failed: {type(error).__name__}: {error}") from error
        if boxes.size == 0:
            boxes = boxes.reshape(0, 4)
        if boxes.ndim != 2 or boxes.shape[1] != 4 or scores.shape != (len(boxes),):
            raise SimulationError(f"{self._name} must return boxes (n, 4) and scores (n,), got {boxes.shape} and {scores.shape}")
        if ((scores < 0) | (scores > 1)).any():
            raise SimulationError(f"{self._name} must return scores in [0, 1], got {scores.min():g} to {scores.max():g}")
        return reported(self._name, *inside(boxes, scores, frame.image.shape[1], frame.image.shape[0]), self._threshold, self._iou)
