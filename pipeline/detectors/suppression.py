"""From raw boxes and scores to what a detector reports."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.core.boxes import nms
from pipeline.core.detections import Detections
from pipeline.errors import InputError, SimulationError

CANDIDATES = 300
"""Most boxes kept before suppression; far more than there are people on a street."""
ROUNDING = 1e-3
"""Half precision may put a score this far outside [0, 1]."""
Floats = NDArray[np.float32]


def check_thresholds(threshold: float, iou: float) -> None:
    """InputError that names the one that is not in (0, 1)."""
    for name, value in {"threshold": threshold, "iou": iou}.items():
        if not 0 < value < 1:
            raise InputError(f"detector.{name} must be in (0, 1), got {value}")


def reported(model: object, boxes: Floats, scores: Floats, threshold: float, iou: float) -> Detections:
    """The boxes (n, 4) whose scores (n,) reach the threshold and that no better one overlaps by more than `iou`, best first.

    SimulationError that names the model if a score, or the box of a score that counts, is not finite, or a score is not in [0, 1].
    """
    if not np.isfinite(scores).all() or not np.isfinite(boxes[scores >= threshold]).all():
        raise SimulationError(f"{model} returns values that are not finite")
    if (wrong := (scores < -ROUNDING) | (scores > 1 + ROUNDING)).any():
        raise SimulationError(f"{model} returns a score of {scores[wrong][0]:.3g}, expected scores in [0, 1]; apply a sigmoid to logits")
    above = np.flatnonzero(scores >= threshold)
    if not len(above):
        return Detections.none()
    if len(above) > CANDIDATES:
        above = above[np.argsort(-scores[above], kind="stable")[:CANDIDATES]]
    kept = above[nms(boxes[above], scores[above], iou)] if len(above) > 1 else above
    return Detections(boxes[kept].astype(np.float32), np.minimum(scores[kept], 1).astype(np.float32))


def inside(boxes: Floats, scores: Floats, width: int, height: int) -> tuple[Floats, Floats]:
    """Boxes cut to an image of a size in pixels, and their scores; boxes outside it are left out. Values that are not finite stay, so that
    `reported` refuses them.
    """
    numbers = np.isfinite(boxes).all(axis=1) & np.isfinite(scores)
    cut = np.where(numbers[:, None], np.clip(boxes, 0, np.array([width, height, width, height], np.float32)), boxes)
    real = (cut[:, 2] > cut[:, 0]) & (cut[:, 3] > cut[:, 1]) | ~numbers
    return cut[real], scores[real]
