"""Where the right answer is not to brake, only a detector that sees people everywhere fails."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pipeline.config.components import make_world
from pipeline.config.composing import compose, functional_scenario
from pipeline.core import kpi
from pipeline.core.kpi import Kpi
from pipeline.core.loop import run_test
from pipeline.detectors.scripted import BlindDetector, EverywhereDetector, VisiblePixelOracle
from pipeline.errors import InputError
from pipeline.protocols import Detector
from pipeline.scenarios.functional import FunctionalScenario
from pipeline.testing import check_world

SMALL = [
    "simulator.camera.width=96",
    "simulator.camera.height=64",
    "aeb.gate=detections",
    "detector=oracle",
]
NO_BRAKING = ("N1", "N2", "N3", "N4")
TESTS = 2


def evaluated(scenario: str, detectors: dict[str, Detector]) -> dict[str, list[Kpi]]:
    """The same random tests with each detector."""
    config, described = compose("default", SMALL), functional_scenario(scenario)
    space = described.logical_space()
    world = make_world(config.simulator, described, config.car.vehicle)
    tests = [space.decode(point) for point in space.sample(TESTS, np.random.default_rng(4))]
    judged = {}
    for name, detector in detectors.items():
        episodes = [run_test(world, detector, config.car, test) for test in tests]
        judged[name] = [kpi.evaluate(episode.signals, 0.1) for episode in episodes]
    return judged


@pytest.mark.parametrize("scenario", NO_BRAKING)
def test_only_the_detector_that_sees_people_everywhere_brakes(scenario: str) -> None:
    tests = evaluated(
        scenario,
        {
            "everywhere": EverywhereDetector(),
            "blind": BlindDetector(),
            "oracle": VisiblePixelOracle(),
        },
    )
    for test in tests["everywhere"]:
        assert (test.failure, test.cause, test.false_activations) == (True, "false_activation", 1)
        assert test.false_activation_s > 1 and test.speed_loss_mps > 5
    for test in (*tests["blind"], *tests["oracle"]):
        assert (test.failure, test.false_activations) == (False, 0)


@pytest.mark.parametrize("scenario", NO_BRAKING)
def test_the_world_keeps_its_contract(scenario: str) -> None:
    config, described = compose("default", SMALL), functional_scenario(scenario)
    world = make_world(config.simulator, described, config.car.vehicle)
    check_world(world, described.logical_space(), VisiblePixelOracle(), count=1)


def test_a_road_on_which_no_braking_would_count_is_refused() -> None:
    slippery = ["vehicle.dry_friction=0.5", "vehicle.wet_friction=0.4"]
    with pytest.raises(
        InputError,
        match=r"vehicle.dry_friction: N1 asks the ego not to brake, "
        r".* needs a friction of 0.51, got 0.5",
    ):
        compose("default", ["search=[F1,N1]", "aeb.gate=detections", *slippery])
    assert compose("default", slippery).vehicle.dry_friction == 0.5


def test_the_blind_detector_fails_where_braking_is_right() -> None:
    for test in evaluated("F1", {"blind": BlindDetector()})["blind"]:
        assert test.failure and test.cause in ("never_seen", "not_solvable")


def test_a_pedestrian_stays_clear_until_the_longest_test_ends() -> None:
    plain = functional_scenario("N2").model_dump(mode="json")
    plain["pedestrian"]["heading_deg"] = 3  # On the path seconds after the unbraked ego has passed.
    with pytest.raises(
        ValueError,
        match="must stay 2.2 m beside the middle of the ego's path, but it comes as near as",
    ):
        FunctionalScenario.model_validate_json(json.dumps(plain))


def test_a_pedestrian_stays_clear_between_the_ends_of_its_shift() -> None:
    plain = functional_scenario("N2").model_dump(mode="json")
    plain["pedestrian"] |= {
        "at": [0, -1.75],
        "heading_deg": 90,
    }  # Without shift it stands on the path; at both ends, 10 m beside it.
    plain["space"]["pedestrian_speed"] |= {"low": 0, "high": 0.3, "step": 0.3}
    plain["space"]["pedestrian_shift"] = {
        "kind": "continuous",
        "unit": "m",
        "low": -10,
        "high": 10,
        "cuts": [0],
    }
    with pytest.raises(ValueError, match="it comes as near as 0.0"):
        FunctionalScenario.model_validate_json(json.dumps(plain))
