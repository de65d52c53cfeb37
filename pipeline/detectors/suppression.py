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
"""Of a detector for which none is chosen: smallest score reported, and overlap above which the worse of two boxes is removed."""
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
    """The boxes (n, 4) with scores (n,) at or above the threshold that no better box overlaps by more than `iou`, best first.

    SimulationError that names the model if a score, or the box of a reported score, is not finite, or a score is not in [0, 1].
    """
    if not np.isfinite(scores).all() or not np.isfinite(boxes[scores >= threshold]).all():
        raise SimulationError(f"{model} returns values that are not finite")
    if (wrong := (scores < -ROUNDING) | (scores > 1 + ROUNDING)).any():
        raise SimulationError(
            f"{model} returns a score of {scores[wrong][0]:.3g}, expected scores in [0, 1]; apply a sigmoid to logits"
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
    """Boxes clipped to an image of a given size in pixels, and their scores; drops boxes outside it. Keeps values that are not finite,
    so that `reported` rejects them."""
    numbers = np.isfinite(boxes).all(axis=1) & np.isfinite(scores)
    cut = np.where(
        numbers[:, None],
        np.clip(boxes, 0, np.array([width, height, width, height], np.float32)),
        boxes,
    )
    real = (cut[:, 2] > cut[:, 0]) & (cut[:, 3] > cut[:, 1]) | ~numbers
    return cut[real], scores[real]
