from __future__ import annotations

import pytest

from pipeline.detectors.evaluation import calibrate, evaluate
from tests.data_sets import (
    AWAY,
    BESIDE,
    EMPTY,
    PALE,
    PERSON,
    TINY,
    VISIBLE,
    detected,
    images,
)


def test_a_perfect_detector() -> None:
    metrics = evaluate([detected((PERSON, 0.9)), detected()], images(VISIBLE, EMPTY), 0.5)
    assert metrics["ap50"] == metrics["ap50_95"] == metrics["precision"] == metrics["recall"] == 1
    assert metrics["false_positives_an_image"] == 0


def test_half_of_the_people_found() -> None:
    metrics = evaluate([detected((PERSON, 0.9)), detected()], images(VISIBLE, VISIBLE), 0.5)
    assert metrics["ap50"] == pytest.approx(51 / 101)
    assert metrics["recall"] == 0.5
    assert metrics["precision"] == 1


def test_a_better_scored_false_positive_halves_the_precision() -> None:
    metrics = evaluate([detected((AWAY, 0.95), (PERSON, 0.9))], images(VISIBLE), 0.5)
    assert metrics["ap50"] == pytest.approx(0.5)
    assert metrics["precision"] == 0.5
    assert metrics["recall"] == 1


def test_a_detection_counts_up_to_its_overlap() -> None:
    shifted = (
        20.0,
        15.0,
        40.0,
        55.0,
    )  # IoU 35 / 45 = 0.78: correct at .5 to .75, six of the ten thresholds.
    metrics = evaluate([detected((shifted, 0.9))], images(VISIBLE), 0.5)
    assert metrics["ap50"] == 1
    assert metrics["ap50_95"] == pytest.approx(0.6)


def test_barely_visible_people_are_ignored_whether_found_or_not() -> None:
    people = images(VISIBLE, TINY, PALE, TINY)
    metrics = evaluate(
        [detected((PERSON, 0.9)), detected((PERSON, 0.8)), detected(), detected()], people, 0.5
    )
    assert metrics["ap50"] == metrics["recall"] == metrics["precision"] == 1
    assert metrics["false_positives_an_image"] == 0


def test_false_positives_are_classified_at_the_threshold() -> None:
    detections = [
        detected((PERSON, 0.9), (PERSON, 0.8), (BESIDE, 0.7), (AWAY, 0.6), (AWAY, 0.4)),
        detected((AWAY, 0.9)),
        detected(),
        detected(),
    ]
    metrics = evaluate(detections, images(VISIBLE, EMPTY, EMPTY, EMPTY), 0.5)
    assert metrics["false_positives_far_an_image"] == 0.5
    assert metrics["false_positives_localisation_an_image"] == 0.25
    assert metrics["false_positives_duplicate_an_image"] == 0.25
    assert metrics["false_positives_an_image"] == 1
    assert metrics["precision"] == pytest.approx(1 / 5)


def test_nothing_found_and_nothing_to_find() -> None:
    assert evaluate([detected()], images(VISIBLE), 0.5)["ap50"] == 0
    assert evaluate([detected((AWAY, 0.9))], images(EMPTY), 0.5)["false_positives_an_image"] == 1


def test_it_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    evaluate([detected((PERSON, 0.9))], images(VISIBLE), 0.5)
    assert capsys.readouterr().out == ""


def test_understated_scores_are_raised_and_ignored_people_do_not_count() -> None:
    hits = [detected((PERSON, 0.5))] * 9 + [detected((AWAY, 0.5))]
    detections = (
        hits
        + [detected((PERSON, 0.1))]
        + [detected((AWAY, 0.1))] * 9
        + [detected((PERSON, 0.1))] * 40
    )
    calibration = calibrate(detections, images(*[VISIBLE] * 20, *[TINY] * 40))
    assert calibration.apply([0.5, 0.1]) == pytest.approx([0.9, 0.1], abs=0.01)


def test_a_score_at_the_threshold_counts() -> None:
    detections = [detected((PERSON, 0.5))]
    assert [
        evaluate(detections, images(VISIBLE), threshold)["recall"] for threshold in (0.5, 0.5000001)
    ] == [1, 0]
