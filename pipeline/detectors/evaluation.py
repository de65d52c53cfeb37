"""Metrics of a detector: COCO's average precision (faster-coco-eval), and precision and recall at its threshold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from faster_coco_eval import COCO, COCOeval_faster
from numpy.typing import NDArray

from pipeline.artefacts.dataset import ImageSet
from pipeline.core.boxes import Box
from pipeline.core.detections import Detections
from pipeline.core.matching import Matching, match
from pipeline.core.reliability import Calibration, platt
from pipeline.core.truth import Truth

KINDS = ("far", "localisation", "duplicate")

CALIBRATED_FROM = 0.05
"""Smallest score used to fit the calibration: lower scores never trigger braking, and thousands of them would distort the fit."""


def evaluate(found: Sequence[Detections], images: ImageSet, threshold: float) -> dict[str, float]:
    """Metrics of a detector on a labelled set.

    found: (n,) the detections in each image at a threshold near 0. threshold: the score threshold in use, in [0, 1]. Returns ap50 and
    ap50_95 (COCO), and at the threshold precision and recall in [0, 1] and false_positives_an_image, in total and by kind. All metrics
    count only visible pedestrians (`Truth.barely_visible`); barely visible ones are ignored, as COCO ignores crowds. A detection on a fully
    hidden pedestrian, who has no visible box, is ignored at the threshold, but a false positive in the average precision.
    """
    ap50_95, ap50 = _average_precision(found, images)
    truths = truths_of(images)
    visible = [not truth.barely_visible for truth in truths]
    matchings = [
        matching_at(threshold, detections, truth)
        for detections, truth in zip(found, truths, strict=True)
    ]
    hits = sum(
        seen and matching.confidence > 0 for seen, matching in zip(visible, matchings, strict=True)
    )
    false = {kind: sum(getattr(matching, kind) for matching in matchings) for kind in KINDS}
    total, count = sum(false.values()), max(1, len(found))
    return {
        "ap50": ap50,
        "ap50_95": ap50_95,
        "precision": hits / max(1, hits + total),
        "recall": hits / max(1, sum(visible)),
        "false_positives_an_image": total / count,
        **{f"false_positives_{kind}_an_image": number / count for kind, number in false.items()},
    }


def truths_of(images: ImageSet) -> list[Truth]:
    """The labels of the images, without the number of pixels that would be visible without occluders."""
    seen, whole = (map(_box, boxes) for boxes in (images.boxes, images.whole_boxes))
    shown = zip(seen, whole, images.visible_pixels, images.contrast, strict=True)
    return [
        Truth(box, whole_box, visible_pixels=int(pixels), contrast=float(contrast))
        for box, whole_box, pixels, contrast in shown
    ]


def matching_at(threshold: float, detections: Detections, truth: Truth) -> Matching:
    """Match the detections at or above the threshold, in [0, 1], with the truth."""
    used = detections.scores >= threshold
    return match(Detections(detections.boxes[used], detections.scores[used]), truth)


def _box(row: NDArray[np.float32]) -> Box | None:
    left, top, right, bottom = (float(value) for value in row)
    return (left, top, right, bottom) if right > left else None


def _average_precision(found: Sequence[Detections], images: ImageSet) -> tuple[float, float]:
    """AP at IoU .5 to .95, and at .5; 0 without labelled or detected pedestrians."""
    annotations = [
        {
            "id": index + 1,
            "image_id": index,
            "category_id": 1,
            "iscrowd": int(truth.barely_visible),
            **_shape(truth.visible_box),
        }
        for index, truth in enumerate(truths_of(images))
        if truth.visible_box is not None
    ]
    results = [
        {"image_id": index, "category_id": 1, "score": float(score), **_shape(box)}
        for index, detections in enumerate(found)
        for box, score in zip(detections.boxes, detections.scores, strict=True)
    ]
    if not results or all(annotation["iscrowd"] for annotation in annotations):
        return 0.0, 0.0
    numbers = [{"id": index} for index in range(len(images))]
    truth = COCO(
        {
            "images": numbers,
            "annotations": annotations,
            "categories": [{"id": 1, "name": "pedestrian"}],
        }
    )
    evaluation = COCOeval_faster(truth, truth.loadRes(results), "bbox")
    evaluation.evaluate()
    evaluation.accumulate()
    evaluation.summarize()
    return float(evaluation.stats[0]), float(evaluation.stats[1])


def _shape(box: Box | NDArray[np.float32]) -> dict[str, Any]:
    left, top, right, bottom = (float(value) for value in box)
    return {
        "bbox": [left, top, right - left, bottom - top],
        "area": (right - left) * (bottom - top),
    }


def judged_scores(
    found: Sequence[Detections], images: ImageSet
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Scores (n,) in [0, 1] of all detections that can trigger braking, and whether each is a true positive; excludes detections of
    barely visible pedestrians."""
    scores: list[float] = []
    right: list[bool] = []
    for detections, truth in zip(found, truths_of(images), strict=True):
        for score, outcome in zip(
            detections.scores, match(detections, truth).outcomes, strict=True
        ):
            if outcome != "ignored" and score >= CALIBRATED_FROM:
                scores.append(float(score))
                right.append(outcome == "true_positive")
    return np.array(scores), np.array(right, bool)


def calibrate(found: Sequence[Detections], images: ImageSet) -> Calibration:
    """Fit a calibration of the scores to whether each detection is a true positive.

    The AEB brakes in proportion to the detector's confidence (thesis section 5.3): with too low a score the car brakes too softly.
    """
    return platt(*judged_scores(found, images))
