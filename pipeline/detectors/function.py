"""Any Python function as a detector."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator

from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.detectors.suppression import IOU, THRESHOLD, Share, inside, reported
from pipeline.errors import InputError, SimulationError, shown


def _named(function: str) -> Callable[..., Any]:
    """The function of a dotted name; ValueError that says why there is none."""
    module, _, name = function.rpartition(".")
    try:
        found = getattr(import_module(module), name)
    except Exception as error:  # A foreign module may raise anything.
        raise ValueError(f"there is no {shown(function)} ({error})") from error
    if not callable(found):
        raise ValueError(
            f"expected a function, got {shown(function)} of type {type(found).__name__}"
        )
    made: Callable[..., Any] = found
    return made


def _is_function(name: str) -> str:
    _named(name)
    return name


def source_of(function: str) -> Path:
    """The file that defines a function of a dotted name; InputError if it is not defined in a Python file."""
    try:
        found = Path(inspect.getfile(inspect.unwrap(_named(function))))
    except (TypeError, ValueError) as error:
        raise InputError(
            f"detector.function: expected a function of a Python file, got {shown(function)} ({error})"
        ) from error
    return found.relative_to(Path.cwd()) if found.is_relative_to(Path.cwd()) else found


FunctionName = Annotated[str, AfterValidator(_is_function)]


class FunctionDetector:
    """Finds pedestrians with a function `image -> (boxes, scores)`.

    function: its dotted name. It takes (h, w, 3) uint8 RGB and returns (n, 4) left, top, right, bottom in pixels and (n,) in [0, 1], in any
    order. threshold, iou: as for `OnnxDetector`. model: ignored, so that it can replace a detector that reads a file.

    InputError if there is no such function. Any exception in it, and any result of another shape, becomes a SimulationError.
    """

    def __init__(
        self,
        function: FunctionName,
        threshold: Share = THRESHOLD,
        iou: Share = IOU,
        model: str | None = None,
    ) -> None:
        try:
            self._function = _named(function)
        except ValueError as error:
            raise InputError(f"detector.function: {error}") from error
        self._name, self._threshold, self._iou = function, threshold, iou

    def detect(self, frame: Frame) -> Detections:
        """Return the pedestrians in the image."""
        try:
            boxes, scores = (
                np.asarray(part, np.float32) for part in self._function(frame.image.copy())
            )
        except Exception as error:  # Foreign code may raise anything; the campaign must continue.
            raise SimulationError(
                f"{self._name} failed: {type(error).__name__}: {error}"
            ) from error
        if boxes.size == 0:
            boxes = boxes.reshape(0, 4)
        if boxes.ndim != 2 or boxes.shape[1] != 4 or scores.shape != (len(boxes),):
            raise SimulationError(
                f"{self._name} must return boxes (n, 4) and scores (n,), got {boxes.shape} and {scores.shape}"
            )
        if ((scores < 0) | (scores > 1)).any():
            raise SimulationError(
                f"{self._name} must return scores in [0, 1], got {scores.min():g} to {scores.max():g}"
            )
        return reported(
            self._name,
            *inside(boxes, scores, frame.image.shape[1], frame.image.shape[0]),
            self._threshold,
            self._iou,
        )
