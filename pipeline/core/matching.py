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
DetectionOutcome = Literal[
    "true_positive", "duplicate", "localisation", "far", "ignored", "unreported"
]
TOUCH_IOU = 0.1


@dataclass(frozen=True)
class Criterion:
    """When a detection counts. iou: overlap with the visible box above which it matches the pedestrian, in [0.1, 1).

    threshold: score from which the detector reports it, in [0, 1]; a weaker one is neither right nor wrong.
    """

    iou: float = 0.5
    threshold: float = 0.0

    def __post_init__(self) -> None:
        if not TOUCH_IOU <= self.iou < 1:
            raise ValueError(f"iou must be in [{TOUCH_IOU}, 1), got {self.iou}")
        if not 0 <= self.threshold <= 1:
            raise ValueError(f"threshold must be in [0, 1], got {self.threshold}")


COCO = Criterion()
"""IoU above 0.5, every detection counts."""


@dataclass(frozen=True)
class Matching:
    """How the detections of one frame fit the pedestrian.

    outcomes: one per detection, in the given order. confidence: in [0, 1], score of the best reported detection that matches the
    pedestrian, 0 if there is none. any_confidence: the same over all detections, reported or not. overlap: in [0, 1], largest IoU of a
    reported detection with the visible box.
    """

    outcomes: tuple[DetectionOutcome, ...] = ()
    confidence: float = 0.0
    any_confidence: float = 0.0
    overlap: float = 0.0

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


def match(detections: Detections, truth: Truth, criterion: Criterion = COCO) -> Matching:
    """Sort the detections of a frame with one pedestrian into true and false positives.

    By IoU with the visible box: above the criterion's the best score is the true positive and the others are duplicates, in (0.1, iou] it
    is a localisation error, below it is far. If the pedestrian is barely visible, a detection with IoU > 0.1 with the visible or the whole
    box is ignored, as COCO ignores crowds: it brakes, but is not a false positive.
    """
    scores = np.asarray(detections.scores, dtype=float)
    seen, whole = _overlap(detections, truth.visible_box), _overlap(detections, truth.whole_box)
    # In single precision, as detectors compare: in double, a score of 0.9 is less than 0.9.
    reported, matches = detections.scores >= criterion.threshold, seen > criterion.iou
    best = _best(scores, matches & reported)
    hardly = truth.barely_visible
    outcomes: list[DetectionOutcome] = [
        _outcome(
            i == best, float(seen[i]), hardly and max(seen[i], whole[i]) > TOUCH_IOU, criterion.iou
        )
        if reported[i]
        else "unreported"
        for i in range(len(scores))
    ]
    return Matching(
        tuple(outcomes),
        confidence=float(scores[best]) if best >= 0 else 0.0,
        any_confidence=float(scores[matches].max(initial=0.0)),
        overlap=float(seen[reported].max(initial=0.0)),
    )


def on_pedestrian(detections: Detections, truth: Truth, criterion: Criterion) -> NDArray[np.bool_]:
    """Whether each detection, reported or not, matches the pedestrian, (n,)."""
    return np.asarray(_overlap(detections, truth.visible_box) > criterion.iou)


def _best(scores: Floats, candidates: NDArray[np.bool_]) -> int:
    """Index of the first best score among the candidates, -1 without any."""
    indices = np.flatnonzero(candidates)
    return int(indices[np.argmax(scores[indices])]) if len(indices) else -1


def _overlap(detections: Detections, box: Box | None) -> Floats:
    return np.zeros(len(detections.boxes)) if box is None else iou(detections.boxes, [box])[:, 0]


def _outcome(best: bool, overlap: float, ignored: bool, match_iou: float) -> DetectionOutcome:
    if ignored:
        return "ignored"
    if best:
        return "true_positive"
    if overlap > match_iou:
        return "duplicate"
    return "localisation" if overlap > TOUCH_IOU else "far"
