"""A detector that is told the truth about the pedestrian, and the changed loops."""

from __future__ import annotations

import numpy as np
import what_is_left

from pipeline.config.composing import compose
from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.core.truth import Truth

BOX = (100.0, 50.0, 120.0, 90.0)
NEAR, FAR = (100.0, 50.0, 120.0, 70.0), (10.0, 10.0, 30.0, 50.0)
FRAME = Frame(np.zeros((192, 320, 3), np.uint8), Truth(BOX, BOX, 800, 800, 40.0))
EMPTY = Frame(FRAME.image, Truth(None, None, 0, 0, 0.0))


class Fixed:
    """Reports a detection elsewhere and one that covers half of the pedestrian."""

    def detect(self, frame: Frame) -> Detections:
        return Detections(np.array([FAR, NEAR], np.float32), np.array([0.9, 0.4], np.float32))


def test_boxes_on_the_pedestrian_become_true_and_keep_their_confidence() -> None:
    found = what_is_left.Helped(Fixed(), least=0.1, boxes=True).detect(FRAME)
    assert found.boxes.tolist() == [list(FAR), list(BOX)] and np.allclose(found.scores, [0.9, 0.4])


def test_confidence_becomes_full_only_on_the_pedestrian() -> None:
    found = what_is_left.Helped(Fixed(), least=0.1, scores=True).detect(FRAME)
    assert found.boxes.tolist() == [list(NEAR), list(FAR)] and np.allclose(found.scores, [1.0, 0.9])
    # Half covered is an IoU of 0.5: no match above 0.5.
    assert np.allclose(
        what_is_left.Helped(Fixed(), least=0.5, scores=True).detect(FRAME).scores, [0.9, 0.4]
    )


def test_nothing_is_told_without_a_pedestrian() -> None:
    assert np.allclose(
        what_is_left.Helped(Fixed(), least=0.1, boxes=True, scores=True).detect(EMPTY).scores,
        [0.9, 0.4],
    )


def test_each_part_changes_the_car_or_the_detector() -> None:
    car = compose("default", []).car
    for name, part in what_is_left.parts(0.5).items():
        changed = part.car(car) != car or not isinstance(part.detector(Fixed()), Fixed)
        assert changed == (name != "as it was")
