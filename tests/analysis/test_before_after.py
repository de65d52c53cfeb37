"""Stills of a test before and after retraining."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pipeline.config.composing import compose
from pipeline.core.detections import Detections
from pipeline.core.episode import Episode, Frame
from pipeline.core.loop import run_test
from pipeline.core.space import Value
from pipeline.detectors.scripted import VisiblePixelOracle
from pipeline.protocols import Detector
from pipeline.report.before_after import before_after, moment
from pipeline.simulators.analytic import AnalyticWorld
from pipeline.testing import CAR

CONFIG = compose("default", [])
SPACE = CONFIG.space("F1")
CLEAR = {
    **SPACE.decode(SPACE.sample(1, np.random.default_rng(0))[0]),
    "fog": 0.0,
    "sun_altitude": 30.0,
}


class Blind:
    """Detects nothing."""

    def detect(self, frame: Frame) -> Detections:
        return Detections.none()


def episode(detector: Detector, concrete: Mapping[str, Value] = CLEAR) -> Episode:
    return run_test(AnalyticWorld(), detector, CAR, concrete, keep_every=1)


def test_the_moment_is_one_image_that_only_the_later_version_detects() -> None:
    before, after = moment(episode(Blind()), episode(VisiblePixelOracle()))
    assert np.array_equal(before.frame.image, after.frame.image)
    assert before.matching.confidence == 0 < after.matching.confidence


def test_versions_that_do_the_same_show_their_last_frame() -> None:
    same = episode(VisiblePixelOracle())
    assert moment(same, same)[0] is same.frames[-1]


def test_captions_say_how_the_tests_end() -> None:
    episodes = episode(Blind()), episode(VisiblePixelOracle())
    shown = before_after("a test", ("base", "adaptive"), episodes, 0.1)
    assert (
        shown.before.caption.startswith("base: contact at ")
        and shown.after.caption == "adaptive: no failure"
    )
    assert (
        shown.before.image.startswith("data:image/jpeg;base64,")
        and shown.before.image != shown.after.image
    )
