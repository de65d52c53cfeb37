"""The analytic simulator keeps the contract and fails exactly in its planted regions."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.config.composing import compose
from pipeline.core import kpi
from pipeline.detectors.scripted import BlindDetector, VisiblePixelOracle
from pipeline.protocols import Detector, Simulator
from pipeline.simulators.analytic import PLANTED, AnalyticSimulator
from pipeline.testing import CAR, check_simulator
from tests.scenarios import scenario_with
from tests.spaces import SMALL, THESIS

SCENARIO = scenario_with(THESIS)
DETECTORS = [VisiblePixelOracle(), BlindDetector()]


@pytest.mark.parametrize("detector", DETECTORS, ids=["oracle", "blind"])
def test_the_simulator_keeps_the_contract(detector: Detector) -> None:
    simulator = AnalyticSimulator(SCENARIO, CAR)
    assert isinstance(simulator, Simulator)
    check_simulator(simulator, THESIS, detector, count=6)


@pytest.mark.parametrize("detector", DETECTORS, ids=["oracle", "blind"])
def test_it_fails_exactly_inside_the_planted_regions(detector: Detector) -> None:
    simulator = AnalyticSimulator(SCENARIO, CAR)
    points = THESIS.sample(400, np.random.default_rng(0))
    failures = [
        kpi.evaluate(simulator.execute(THESIS.decode(point), detector).signals, 0.1).failure
        for point in points
    ]
    planted = simulator.planted(points)
    assert np.array_equal(failures, planted >= 0)
    assert 0.05 < np.mean(failures) < 0.25


def test_every_region_is_planted() -> None:
    labels = AnalyticSimulator(SCENARIO, CAR).planted(THESIS.sample(4000, np.random.default_rng(0)))
    assert set(labels.tolist()) == {-1, *range(len(PLANTED))}


def test_frames_are_kept_as_asked() -> None:
    concrete = THESIS.decode(THESIS.sample(1, np.random.default_rng(1))[0])
    episode = AnalyticSimulator(SCENARIO, CAR).execute(concrete, VisiblePixelOracle(), keep_every=3)
    rows = len(episode.signals["time_s"])
    assert [kept.step for kept in episode.frames] == list(range(0, rows, 3))


def test_its_frames_can_teach_a_shipped_detector() -> None:
    """They have the default camera's size, and some show no pedestrian."""
    concrete = THESIS.decode(THESIS.sample(1, np.random.default_rng(1))[0])
    frames = [
        kept.frame
        for kept in AnalyticSimulator(SCENARIO, CAR)
        .execute(concrete, BlindDetector(), keep_every=1)
        .frames
    ]
    camera = compose("default", []).camera
    assert {frame.image.shape for frame in frames} == {(camera["height"], camera["width"], 3)}
    assert {frame.truth.visible_pixels == 0 for frame in frames} == {True, False}


def test_a_scenario_of_another_space_is_refused() -> None:
    with pytest.raises(
        ValueError, match=r"^variables must be \[.+\]; missing \[.+\], unknown \[.+\]$"
    ):
        AnalyticSimulator(SCENARIO, CAR).execute(
            SMALL.decode(SMALL.sample(1, np.random.default_rng(0))[0]), BlindDetector()
        )
