"""Turns raw boxes and scores into a detector's report."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pipeline.core.boxes import nms
from pipeline.core.detections import Detections
from pipeline.errors import SimulationError

THRESHOLD, IOU = 0.5, 0.45
"""Defaults: smallest score reported, and overlap above which the worse of two boxes is removed."""
CANDIDATES = 300
"""Largest number of boxes before suppression; far more than people on a street."""
ROUNDING = 1e-3
"""Tolerance of scores outside [0, 1], for rounding in half precision."""
Floats = NDArray[np.float32]
Share = Annotated[float, Field(gt=0, lt=1)]
"""A threshold of scores or of IoU. It is checked when a detector is made from a config."""


def reported(
    model: object, boxes: Floats, scores: Floats, threshold: float, iou: float
) -> Detections:
    """The boxes at or above the threshold that no better box overlaps, best first.

    Args:
        model: for the message.
        boxes: (n, 4) left, top, right, bottom in pixels.
        scores: (n,), in [0, 1].
        threshold: smallest score reported, in (0, 1).
        iou: overlap above which the worse of two boxes is removed, in (0, 1).

    Raises:
        SimulationError: if a score, or the box of a reported score, is not finite, or a score is
            not in [0, 1].

    >>> boxes = np.array([[0, 0, 10, 10], [1, 0, 10, 10], [20, 0, 30, 10]], np.float32)
    >>> reported("model", boxes, np.array([0.6, 0.9, 0.2], np.float32), 0.5, 0.45).boxes.tolist()
    [[1.0, 0.0, 10.0, 10.0]]
    """
    if not np.isfinite(scores).all() or not np.isfinite(boxes[scores >= threshold]).all():
        raise SimulationError(f"{model} returns values that are not finite")
    if (wrong := (scores < -ROUNDING) | (scores > 1 + ROUNDING)).any():
        raise SimulationError(
            f"{model} returns a score of {scores[wrong][0]:.3g}, expected scores in [0, 1];"
            " apply a sigmoid to logits"
        )
    above = np.flatnonzero(scores >= threshold)
    if not len(above):
        return Detections.none()
    if len(above) > CANDIDATES:
        above = above[np.argsort(-scores[above], kind="stable")[:CANDIDATES]]
    kept = above[nms(boxes[above], scores[above], iou)] if len(above) > 1 else above
    return Detections(
        boxes[kept].astype(np.float32), np.minimum(scores[kept], 1).astype(np.float32)
    )


def inside(boxes: Floats, scores: Floats, width: int, height: int) -> tuple[Floats, Floats]:
    """Clip boxes to an image and drop those outside it.

    Values that are not finite are kept, so that `reported` rejects them.

    Args:
        boxes: (n, 4) left, top, right, bottom in pixels.
        scores: (n,).
        width, height: of the image in pixels.

    Returns:
        Boxes (m, 4) and scores (m,).
    """
    numbers = np.isfinite(boxes).all(axis=1) & np.isfinite(scores)
    clipped = np.clip(boxes, 0, np.array([width, height, width, height], np.float32))
    cut = np.where(numbers[:, None], clipped, boxes)
    real = (cut[:, 2] > cut[:, 0]) & (cut[:, 3] > cut[:, 1]) | ~numbers
    return cut[real], scores[real]
