"""The analytic world keeps the contract and fails exactly in its planted regions."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.config.composing import compose
from pipeline.core import kpi
from pipeline.core.episode import Episode
from pipeline.core.loop import run_test
from pipeline.core.space import Floats
from pipeline.detectors.scripted import BlindDetector, VisiblePixelOracle
from pipeline.protocols import Detector, World
from pipeline.simulators.analytic import PLANTED, AnalyticWorld, planted, sight_m
from pipeline.testing import CAR, check_world
from tests.spaces import THESIS

ORACLE = VisiblePixelOracle()


@pytest.mark.parametrize("detector", [ORACLE, BlindDetector()], ids=["oracle", "blind"])
def test_the_world_keeps_the_contract(detector: Detector) -> None:
    assert isinstance(AnalyticWorld(), World)
    check_world(AnalyticWorld(), THESIS, detector, count=6)


def evaluated(detector: Detector, points: Floats) -> list[kpi.Kpi]:
    episodes = [run_test(AnalyticWorld(), detector, CAR, THESIS.decode(point)) for point in points]
    return [kpi.evaluate(episode.signals, 0.1) for episode in episodes]


def test_who_sees_what_a_person_sees_fails_exactly_inside_the_planted_regions() -> None:
    points = THESIS.sample(400, np.random.default_rng(0))
    failures = [test.failure for test in evaluated(ORACLE, points)]
    assert np.array_equal(failures, planted(map(THESIS.decode, points)) >= 0)
    assert 0.05 < np.mean(failures) < 0.25


def test_the_margin_of_a_region_is_a_gradient() -> None:
    points = THESIS.sample(200, np.random.default_rng(0))
    metres = [int(sight_m(THESIS.decode(point))) for point in points]
    ttc_s: dict[int, float] = {}
    for metre, test in zip(metres, evaluated(ORACLE, points), strict=True):
        assert ttc_s.setdefault(metre, test.adj_ttc_s) == test.adj_ttc_s, "the metre decides"
    rising = [ttc_s[metre] for metre in sorted(ttc_s)]
    assert len(rising) > 5 and rising == sorted(set(rising))


def test_a_blind_detector_never_brakes() -> None:
    points = THESIS.sample(20, np.random.default_rng(2))
    assert all(test.failure_mode == "contact" for test in evaluated(BlindDetector(), points))


def test_every_region_is_planted() -> None:
    points = THESIS.sample(4000, np.random.default_rng(0))
    assert set(planted(map(THESIS.decode, points)).tolist()) == {-1, *range(len(PLANTED))}


def example(detector: Detector, keep_every: int) -> Episode:
    concrete = THESIS.decode(THESIS.sample(1, np.random.default_rng(1))[0])
    return run_test(AnalyticWorld(), detector, CAR, concrete, keep_every=keep_every)


def test_frames_are_kept_as_asked() -> None:
    episode = example(ORACLE, keep_every=3)
    steps = len(episode.signals["time_s"]) - 1  # The last row has no frame.
    assert [kept.step for kept in episode.frames] == list(range(0, steps, 3))
    assert not example(ORACLE, keep_every=0).frames


def test_its_frames_can_teach_a_shipped_detector() -> None:
    """They have the default camera's size, and some show no pedestrian."""
    frames = [kept.frame for kept in example(BlindDetector(), keep_every=1).frames]
    camera = compose("default", []).camera
    assert {frame.image.shape for frame in frames} == {(camera["height"], camera["width"], 3)}
    assert {frame.truth.visible_pixels == 0 for frame in frames} == {True, False}
