"""True and false positives of a frame, by hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from pipeline.core.boxes import Box
from pipeline.core.detections import Detections
from pipeline.core.matching import Criterion, match
from pipeline.core.truth import Truth

BOX = (10.0, 10.0, 20.0, 30.0)
VISIBLE = Truth(BOX, BOX, 200, 200, 50.0)


def said(*boxes: Box, scores: Sequence[float] = (0.9, 0.8, 0.7, 0.6)) -> Detections:
    return Detections(
        np.array(boxes, np.float32).reshape(-1, 4), np.array(scores[: len(boxes)], np.float32)
    )


def test_match_sorts_detections_into_kinds() -> None:
    found = said((10, 10, 20, 29), (10, 10, 20, 18), (100, 10, 110, 30), BOX)
    result = match(found, VISIBLE)
    assert result.outcomes == ("true_positive", "localisation", "far", "duplicate")
    assert (result.far, result.localisation, result.duplicate, result.false_positives) == (
        1,
        1,
        1,
        3,
    )
    assert result.confidence == pytest.approx(0.9)


@pytest.mark.parametrize("truth", [Truth(BOX, BOX, 29, 200, 50.0), Truth(BOX, BOX, 200, 200, 7.9)])
def test_detections_of_a_barely_visible_pedestrian_are_ignored_but_brake(truth: Truth) -> None:
    assert truth.barely_visible and not VISIBLE.barely_visible
    result = match(said(BOX, (10, 10, 20, 18), (100, 10, 110, 30)), truth)
    assert result.outcomes == ("ignored", "ignored", "far")
    assert result.confidence == pytest.approx(0.9)


def test_match_without_a_pedestrian_or_without_detections() -> None:
    assert match(said(BOX), Truth()).outcomes == ("far",)
    hidden = match(said(BOX), Truth(None, BOX))
    assert (hidden.outcomes, hidden.confidence) == (("ignored",), 0)
    assert match(Detections.none(), VISIBLE).confidence == 0


def test_an_iou_of_exactly_a_half_is_a_localisation_error() -> None:
    assert match(said((10, 10, 20, 20)), VISIBLE).outcomes == ("localisation",)


def test_a_detection_below_the_threshold_is_neither_right_nor_wrong() -> None:
    found = said((100, 10, 110, 30), (10, 10, 20, 18), BOX, scores=(0.5, 0.49, 0.3))
    result = match(found, VISIBLE, Criterion(threshold=0.5))
    assert result.outcomes == ("far", "unreported", "unreported")
    assert (result.confidence, result.overlap, result.any_confidence) == pytest.approx((0, 0, 0.3))


def test_the_brake_follows_what_matches_and_nothing_at_the_limit_itself() -> None:
    found = said((10, 10, 20, 20), BOX, scores=(0.9, 0.1))
    assert match(found, VISIBLE, Criterion(threshold=0.5)).matches == (False, True)


@pytest.mark.parametrize("threshold", [0.5, 0.7, 0.9, 0.95])
def test_a_detection_with_the_score_of_the_threshold_is_reported(threshold: float) -> None:
    # In single precision, 0.7, 0.9 and 0.95 are less than in double.
    assert match(
        said(BOX, scores=[threshold]), VISIBLE, Criterion(threshold=threshold)
    ).outcomes == ("true_positive",)
