"""Sorts the detections of a frame into true and false positives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.boxes import Box, iou
from pipeline.core.detections import Detections
from pipeline.core.truth import Truth

Floats = NDArray[np.float64]
DetectionOutcome = Literal["true_positive", "duplicate", "localisation", "far", "ignored"]
MATCH_IOU = 0.5
TOUCH_IOU = 0.1


@dataclass(frozen=True)
class Matching:
    """The outcome of each detection of one frame.

    outcomes: one per detection, in the given order. confidence: in [0, 1], score of the best detection that matches the pedestrian (IoU >
    0.5), 0 if there is none; it is the brake demand.
    """

    outcomes: tuple[DetectionOutcome, ...] = ()
    confidence: float = 0.0

    @property
    def far(self) -> int:
        return self.outcomes.count("far")

    @property
    def localisation(self) -> int:
        return self.outcomes.count("localisation")

    @property
    def duplicate(self) -> int:
        return self.outcomes.count("duplicate")

    @property
    def false_positives(self) -> int:
        """The false positives that Eq. 5.3 counts."""
        return self.far + self.localisation + self.duplicate


def match(detections: Detections, truth: Truth) -> Matching:
    """Sort the detections of a frame with one pedestrian into true and false positives.

    By IoU with the visible box: above 0.5 the best score is the true positive and the others are duplicates, in (0.1, 0.5] it is a
    localisation error, below it is far. If the pedestrian is barely visible, a detection with IoU > 0.1 with the visible or the whole box
    is ignored, as COCO ignores crowds: it brakes, but is not a false positive.
    """
    scores = np.asarray(detections.scores, dtype=float)
    seen, whole = _overlap(detections, truth.visible_box), _overlap(detections, truth.whole_box)
    on_pedestrian = np.flatnonzero(seen > MATCH_IOU)
    best = int(on_pedestrian[np.argmax(scores[on_pedestrian])]) if len(on_pedestrian) else -1
    confidence = float(scores[best]) if len(on_pedestrian) else 0.0
    hardly = truth.barely_visible
    outcomes = [_outcome(i == best, seen[i], hardly and max(seen[i], whole[i]) > TOUCH_IOU) for i in range(len(scores))]
    return Matching(tuple(outcomes), confidence)


def _overlap(detections: Detections, box: Box | None) -> Floats:
    return np.zeros(len(detections.boxes)) if box is None else iou(detections.boxes, [box])[:, 0]


def _outcome(best: bool, overlap: float, ignored: bool) -> DetectionOutcome:
    if ignored:
        return "ignored"
    if best:
        return "true_positive"
    if overlap > MATCH_IOU:
        return "duplicate"
    return "localisation" if overlap > TOUCH_IOU else "far"
