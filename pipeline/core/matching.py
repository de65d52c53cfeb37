"""Sorts the detections of a frame into true and false positives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.boxes import Box, iou
from pipeline.core.detections import Detections
from pipeline.core.truth import Truth

DetectionOutcome = Literal[
    "true_positive", "duplicate", "localisation", "far", "ignored", "unreported"
]
TOUCH_IOU = 0.1


@dataclass(frozen=True)
class Criterion:
    """When a detection counts.

    Attributes:
        iou: overlap with the visible box above which a detection matches the pedestrian, in
            [0.1, 1).
        threshold: score from which the detector reports a detection, in [0, 1]; a weaker one is
            neither right nor wrong.
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

    Attributes:
        outcomes: of each detection, in the given order.
        confidence: score of the best reported detection that matches the pedestrian, in [0, 1], 0
            if there is none.
        any_confidence: the same over all detections, reported or not.
        overlap: largest IoU of a reported detection with the visible box, in [0, 1].
        matches: of each detection, reported or not, whether it matches the pedestrian.
    """

    outcomes: tuple[DetectionOutcome, ...] = ()
    confidence: float = 0.0
    any_confidence: float = 0.0
    overlap: float = 0.0
    matches: tuple[bool, ...] = ()

    @property
    def far(self) -> int:
        """Number of false positives away from the pedestrian."""
        return self.outcomes.count("far")

    @property
    def localisation(self) -> int:
        """Number of false positives that fit the pedestrian poorly."""
        return self.outcomes.count("localisation")

    @property
    def duplicate(self) -> int:
        """Number of false positives in addition to a better match."""
        return self.outcomes.count("duplicate")

    @property
    def false_positives(self) -> int:
        """The false positives that Eq. 5.3 counts."""
        return self.far + self.localisation + self.duplicate


def match(detections: Detections, truth: Truth, criterion: Criterion = COCO) -> Matching:
    """Sort the detections of a frame with one pedestrian into true and false positives.

    By IoU with the visible box: of those above the criterion's IoU the best score is the true
    positive and the others are duplicates, in (0.1, iou] a detection is a localisation error, below
    it is far. If the pedestrian is barely visible, a detection with IoU > 0.1 with the visible or
    the whole box is ignored, as COCO ignores crowds: it brakes, but is not a false positive.

    Args:
        detections: of the frame, reported or not.
        truth: of the frame.
        criterion: when a detection is reported, and when it matches.

    >>> box, aside = (10.0, 10.0, 20.0, 40.0), (60.0, 10.0, 70.0, 40.0)
    >>> boxes, scores = np.array([box, aside], np.float32), np.array([0.9, 0.4], np.float32)
    >>> truth = Truth(box, box, visible_pixels=300, whole_pixels=300, contrast=50.0)
    >>> match(Detections(boxes, scores), truth).outcomes
    ('true_positive', 'far')
    """
    if not len(detections.scores):
        return Matching()
    scores = np.asarray(detections.scores, dtype=float)
    seen = touching = _overlap(detections, truth.visible_box)
    # In single precision, as detectors compare: in double, a score of 0.9 is less than 0.9.
    reported, matches = detections.scores >= criterion.threshold, seen > criterion.iou
    if truth.barely_visible:
        touching = np.maximum(seen, _overlap(detections, truth.whole_box))
    candidates = np.flatnonzero(matches & reported)
    best = int(candidates[np.argmax(scores[candidates])]) if len(candidates) else -1
    outcomes: list[DetectionOutcome] = []
    for i in range(len(scores)):
        if not reported[i]:
            outcomes.append("unreported")
        elif truth.barely_visible and touching[i] > TOUCH_IOU:
            outcomes.append("ignored")
        elif i == best:
            outcomes.append("true_positive")
        elif matches[i]:
            outcomes.append("duplicate")
        else:
            outcomes.append("localisation" if seen[i] > TOUCH_IOU else "far")
    return Matching(
        tuple(outcomes),
        confidence=float(scores[best]) if best >= 0 else 0.0,
        any_confidence=float(scores[matches].max(initial=0.0)),
        overlap=float(seen[reported].max(initial=0.0)),
        matches=tuple(matches.tolist()),
    )


def _overlap(detections: Detections, box: Box | None) -> NDArray[np.float64]:
    return np.zeros(len(detections.boxes)) if box is None else iou(detections.boxes, [box])[:, 0]
