"""Metrics of a detector: COCO's average precision, and precision and recall at its threshold."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
"""Of false positives."""
CALIBRATED_FROM = 0.05
"""Smallest score used to fit the calibration.

Lower scores never trigger braking, and thousands of them would distort the fit."""


def evaluate(
    detections: Sequence[Detections], images: ImageSet, threshold: float
) -> dict[str, float]:
    """Metrics of a detector on a labelled set.

    All metrics count only visible pedestrians (`Truth.barely_visible`); barely visible ones are
    ignored, as COCO ignores crowds. A detection on a fully hidden pedestrian, who has no visible
    box, is ignored at the threshold, but a false positive in the average precision.

    Args:
        detections: (n,) the detections in each image at a threshold near 0.
        images: the n images and their labels.
        threshold: the score threshold in use, in [0, 1].

    Returns:
        ap50 and ap50_95 (COCO); and at the threshold precision and recall in [0, 1] and
        false_positives_an_image, in total and by kind.
    """
    ap50_95, ap50 = _average_precision(detections, images)
    truths = truths_of(images)
    visible = [not truth.barely_visible for truth in truths]
    pairs = zip(detections, truths, strict=True)
    matchings = [matching_at(threshold, each, truth) for each, truth in pairs]
    hits = 0
    for seen, matching in zip(visible, matchings, strict=True):
        hits += seen and matching.confidence > 0
    count = max(1, len(detections))
    total, by_kind = 0, {}
    for kind in KINDS:
        number = sum(getattr(matching, kind) for matching in matchings)
        by_kind[f"false_positives_{kind}_an_image"] = number / count
        total += number
    return {
        "ap50": ap50,
        "ap50_95": ap50_95,
        "precision": hits / max(1, hits + total),
        "recall": hits / max(1, sum(visible)),
        "false_positives_an_image": total / count,
        **by_kind,
    }


def truths_of(images: ImageSet) -> list[Truth]:
    """The labels of the images, without the pixels that would be visible without occluders."""
    truths = []
    for visible, whole, pixels, contrast in zip(
        images.boxes, images.whole_boxes, images.visible_pixels, images.contrast, strict=True
    ):
        boxes: list[Box | None] = []
        for left, top, right, bottom in (visible.tolist(), whole.tolist()):
            # A box without a width stands for none.
            boxes.append((left, top, right, bottom) if right > left else None)
        truth = Truth(boxes[0], boxes[1], visible_pixels=int(pixels), contrast=float(contrast))
        truths.append(truth)
    return truths


def matching_at(threshold: float, detections: Detections, truth: Truth) -> Matching:
    """Match the detections at or above the threshold, in [0, 1], with the truth."""
    used = detections.scores >= threshold
    return match(Detections(detections.boxes[used], detections.scores[used]), truth)


def _average_precision(detections: Sequence[Detections], images: ImageSet) -> tuple[float, float]:
    """AP at IoU .5 to .95, and at .5; 0 without labelled or detected pedestrians."""
    annotations, results = [], []
    for index, truth in enumerate(truths_of(images)):
        if truth.visible_box is not None:
            label = {"id": index + 1, "iscrowd": int(truth.barely_visible)}
            annotations.append({**_coco(index, truth.visible_box), **label})
    for index, each in enumerate(detections):
        for box, score in zip(each.boxes, each.scores, strict=True):
            results.append({**_coco(index, box), "score": float(score)})
    if not results or all(annotation["iscrowd"] for annotation in annotations):
        return 0.0, 0.0
    truth_set = COCO(
        {
            "images": [{"id": index} for index in range(len(images))],
            "annotations": annotations,
            "categories": [{"id": 1, "name": "pedestrian"}],
        }
    )
    evaluation = COCOeval_faster(truth_set, truth_set.loadRes(results), "bbox")
    evaluation.evaluate()
    evaluation.accumulate()
    evaluation.summarize()
    return float(evaluation.stats[0]), float(evaluation.stats[1])


def _coco(image: int, box: Iterable[float]) -> dict[str, Any]:
    """A pedestrian in COCO's form."""
    left, top, right, bottom = (float(value) for value in box)
    width, height = right - left, bottom - top
    shape = {"bbox": [left, top, width, height], "area": width * height}
    return {"image_id": image, "category_id": 1, **shape}


def judged_scores(
    detections: Sequence[Detections], images: ImageSet
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Scores of all detections that can trigger braking, and whether each is a true positive.

    Detections of barely visible pedestrians are left out.

    Args:
        detections: (n,) the detections in each image.
        images: the n images and their labels.

    Returns:
        Scores (m,) in [0, 1], and (m,) whether each is a true positive.
    """
    scores: list[float] = []
    right: list[bool] = []
    for each, truth in zip(detections, truths_of(images), strict=True):
        for score, outcome in zip(each.scores, match(each, truth).outcomes, strict=True):
            if outcome != "ignored" and score >= CALIBRATED_FROM:
                scores.append(float(score))
                right.append(outcome == "true_positive")
    return np.array(scores), np.array(right, bool)


def calibrate(detections: Sequence[Detections], images: ImageSet) -> Calibration:
    """Fit a calibration of the scores to whether each detection is a true positive.

    The AEB brakes in proportion to the detector's confidence (thesis section 5.3): with too low a
    score the car brakes too softly.

    Args: as for `judged_scores`.
    """
    return platt(*judged_scores(detections, images))
