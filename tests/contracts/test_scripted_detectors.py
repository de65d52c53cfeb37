"""The scripted stand-ins keep the contract, and the checker finds a faulty detector."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.core.ground import Pinhole
from pipeline.core.truth import Truth
from pipeline.detectors.scripted import BlindDetector, EverywhereDetector, VisiblePixelOracle
from pipeline.protocols import Detector
from pipeline.testing import check_detector

IMAGE = np.zeros((48, 64, 3), np.uint8)
BOX = (10.0, 10.0, 20.0, 40.0)


STAND_INS = (VisiblePixelOracle, BlindDetector, EverywhereDetector)


@pytest.mark.parametrize(
    "detector", [detector for kind in STAND_INS for detector in (kind(), kind(model="any"))]
)
def test_stand_ins_keep_the_contract(detector: Detector) -> None:
    assert isinstance(detector, Detector)
    check_detector(detector, 64, 48)


def test_the_oracle_sees_what_a_person_sees() -> None:
    oracle = VisiblePixelOracle()
    seen = oracle.detect(Frame(IMAGE, Truth(BOX, BOX, 30, 30, 8.0)))
    assert seen.boxes.tolist() == [list(BOX)] and seen.scores.tolist() == [1]
    for truth in (
        Truth(BOX, BOX, 29, 300, 50.0),
        Truth(BOX, BOX, 300, 300, 7.9),
        Truth(None, BOX, 0, 300, 0.0),
    ):
        assert not len(oracle.detect(Frame(IMAGE, truth)).scores)


def test_the_person_seen_everywhere_stands_ten_metres_ahead() -> None:
    detections = EverywhereDetector().detect(Frame(np.zeros((192, 320, 3), np.uint8), Truth()))
    assert detections.scores.tolist() == [1]
    focal = 160 / np.tan(np.radians(30))
    left, top, right, bottom = detections.boxes[0]
    assert Pinhole(320, 192, focal, 0, 1.35).ground(detections.boxes)[0] == pytest.approx(
        (10, 0), abs=0.05
    )
    assert 10 / focal * np.array([bottom - top, right - left]) == pytest.approx(
        (1.7, 0.55), abs=0.01
    )


class Restless:
    """Reports different boxes each time."""

    def __init__(self) -> None:
        self._calls = 0

    def detect(self, frame: Frame) -> Detections:
        self._calls += 1
        return Detections(np.array([[0, 0, self._calls, 10]], np.float32), np.ones(1, np.float32))


class Painter:
    """Writes into the image."""

    def detect(self, frame: Frame) -> Detections:
        frame.image[0, 0] += 1
        return Detections.none()


class Astray:
    """Reports a box outside the image."""

    def detect(self, frame: Frame) -> Detections:
        return Detections(np.array([[900, 0, 910, 10]], np.float32), np.ones(1, np.float32))


class Plain:
    """Returns boxes and scores as a tuple."""

    def detect(self, frame: Frame) -> Any:
        return np.zeros((0, 4), np.float32), np.zeros(0, np.float32)


@pytest.mark.parametrize(
    ("detector", "message"),
    [
        (Restless(), "deterministic"),
        (Painter(), "not change"),
        (Astray(), "touch the image"),
        (Plain(), "must return pipeline.core.detections.Detections, got tuple"),
    ],
)
def test_the_checker_finds_faulty_detectors(detector: Detector, message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_detector(detector, 64, 48)
