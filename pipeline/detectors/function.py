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
        attribute: Any = getattr(import_module(module), name)
    except Exception as error:  # A foreign module may raise anything.
        raise ValueError(f"there is no {shown(function)} ({error})") from error
    if not callable(attribute):
        raise ValueError(
            f"expected a function, got {shown(function)} of type {type(attribute).__name__}"
        )
    return attribute  # type: ignore[no-any-return]


def _is_function(name: str) -> str:
    _named(name)
    return name


def source_of(function: str) -> Path:
    """The file that defines a function, relative to the working directory if it is inside.

    Args:
        function: its dotted name.

    Raises:
        InputError: if it is not defined in a Python file.
    """
    try:
        file = Path(inspect.getfile(inspect.unwrap(_named(function))))
    except (TypeError, ValueError) as error:
        raise InputError(
            f"detector.function: expected a function of a Python file, got {shown(function)}"
            f" ({error})"
        ) from error
    return file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file


FunctionName = Annotated[str, AfterValidator(_is_function)]


class FunctionDetector:
    """Finds pedestrians with a function `image -> (boxes, scores)`.

    Args:
        function: its dotted name. It takes (h, w, 3) uint8 RGB and returns (n, 4) left, top, right,
            bottom in pixels and (n,) scores in [0, 1], in any order.
        threshold, iou: as for `OnnxDetector`.
        model: ignored, so that it can replace a detector that reads a file.

    Raises:
        InputError: if there is no such function.
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
        """Return the pedestrians in the image.

        Raises:
            SimulationError: for any exception in the function, and for any result of another shape
                or range.
        """
        try:
            result = self._function(frame.image.copy())
            boxes, scores = (np.asarray(part, np.float32) for part in result)
        except Exception as error:  # Foreign code may raise anything; the campaign must continue.
            raise SimulationError(
                f"{self._name} failed: {type(error).__name__}: {error}"
            ) from error
        if boxes.size == 0:
            boxes = boxes.reshape(0, 4)
        if boxes.ndim != 2 or boxes.shape[1] != 4 or scores.shape != (len(boxes),):
            raise SimulationError(
                f"{self._name} must return boxes (n, 4) and scores (n,),"
                f" got {boxes.shape} and {scores.shape}"
            )
        if ((scores < 0) | (scores > 1)).any():
            raise SimulationError(
                f"{self._name} must return scores in [0, 1],"
                f" got {scores.min():g} to {scores.max():g}"
            )
        height, width = frame.image.shape[:2]
        boxes, scores = inside(boxes, scores, width, height)
        return reported(self._name, boxes, scores, self._threshold, self._iou)
