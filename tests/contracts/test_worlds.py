"""The toy world of the examples keeps the contract, and the checker rejects faulty worlds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import pytest

from examples.toy_world import ToyWorld
from pipeline.config.components import make_world
from pipeline.config.composing import compose, functional_scenario
from pipeline.core import kpi
from pipeline.core.encounter import Encounter, RoadUsers
from pipeline.core.loop import run_test
from pipeline.core.space import Value
from pipeline.detectors.scripted import BlindDetector, VisiblePixelOracle
from pipeline.errors import InputError
from pipeline.protocols import Observation, World
from pipeline.simulators.analytic import AnalyticWorld
from pipeline.testing import CAR, check_world
from tests.spaces import THESIS

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "toy_world.py"
HOWTO = ROOT / "docs" / "howto" / "own-simulator.md"


@pytest.mark.parametrize("name", ["F1", "F5"])
def test_the_toy_world_keeps_the_contract(name: str) -> None:
    scenario = functional_scenario(name)
    world = ToyWorld(scenario, CAR.vehicle)
    assert isinstance(world, World)
    check_world(world, scenario.logical_space(), VisiblePixelOracle())


def test_the_toy_world_hides_the_pedestrian_in_fog() -> None:
    world = ToyWorld(functional_scenario("F3"), CAR.vehicle)
    failures = {}
    for fog in (0.0, 99.0):
        concrete = {"fog": fog, "pedestrian_speed": 1.5}
        episode = run_test(world, VisiblePixelOracle(), CAR, concrete)
        failures[fog] = kpi.evaluate(episode.signals, 0.1).failure
    assert failures == {0.0: False, 99.0: True}


def test_a_study_can_name_the_toy_world() -> None:
    words = ["simulator=analytic", "simulator._target_=examples.toy_world.ToyWorld"]
    config = compose("smoke", words)
    world = make_world(config.simulator, config.scenarios["F1"], config.car.vehicle)
    assert isinstance(world, ToyWorld)


def test_the_example_needs_no_image_library() -> None:
    text = EXAMPLE.read_text()
    assert not any(name in text for name in ("cv2", "PIL", "mujoco"))
    code = [line for line in text.partition("class ToyWorld")[2].splitlines() if line.strip()]
    assert len(code) <= 40


class Restless(AnalyticWorld):
    """Its road changes from test to test."""

    resets = 0

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        self.resets += 1
        encounter = super().reset(concrete, seed)
        self._speed_mps += 0.1 * self.resets
        return encounter


class Moves(AnalyticWorld):
    """Moves while it observes."""

    def observe(self) -> Observation:
        self.advance(0.1, 0.0)
        return super().observe()


class Accelerates(AnalyticWorld):
    """Takes a deceleration for an acceleration."""

    def advance(self, seconds: float, acceleration_mps2: float) -> RoadUsers:
        return super().advance(seconds, -acceleration_mps2)


class Dawdles(AnalyticWorld):
    """Its clock runs slowly."""

    def advance(self, seconds: float, acceleration_mps2: float) -> RoadUsers:
        return super().advance(seconds / 2, acceleration_mps2)


class Grey(AnalyticWorld):
    """Its images have one channel."""

    def observe(self) -> Observation:
        seen = super().observe()
        return replace(seen, image=seen.image[..., 0])


class Silent(AnalyticWorld):
    """Returns no encounter."""

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Any:
        super().reset(concrete, seed)


class Uneven(AnalyticWorld):
    """Cannot divide the time between two images."""

    step_s = 0.07


@pytest.mark.parametrize(
    ("world", "message"),
    [
        (Restless(), "must be the same in a replay"),
        (Moves(), "observe must not move the road users"),
        (Accelerates(), "must not become faster under a negative acceleration"),
        (Dawdles(), "advance must take 0.1 s, took 0.05 s"),
        (Grey(), r"images must be \(192, 320, 3\) uint8, as `camera` says, got \(192, 320\)"),
        (Silent(), "reset must return pipeline.core.encounter.Encounter, got NoneType"),
        (Uneven(), "frame_s must be a multiple of step_s, got 0.1 s and 0.07 s"),
    ],
)
def test_the_checker_rejects_a_faulty_world(world: World, message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_world(world, THESIS, BlindDetector())


class OldSimulator:
    """Executes whole tests itself."""

    def __init__(self, scenario: object, car: object) -> None: ...

    def execute(self, concrete: Mapping[str, Value], detector: object) -> None: ...


class Boundless(AnalyticWorld):
    """Does not take the brakes of the study."""

    needs: ClassVar[dict[str, Any]] = {}

    def __init__(self, scenario: object) -> None: ...


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (
            f"{__name__}.OldSimulator",
            "expected a class with reset, observe and advance, a World, got ",
        ),
        (
            "pipeline.detectors.scripted.BlindDetector",
            "expected a class with reset, observe and advance, a World, got ",
        ),
        ("pipeline.protocols.World", "a World that can be instantiated; .* is abstract"),
        (f"{__name__}.Boundless", "must take the parameter 'vehicle'"),
    ],
)
def test_a_config_that_names_no_world_is_an_error(target: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"simulator\._target_: .*{message}"):
        compose("smoke", ["simulator=analytic", f"simulator._target_={target}"])


def test_the_howto_shows_the_example() -> None:
    assert "examples/toy_world.py" in HOWTO.read_text()
    assert len(HOWTO.read_text().split()) <= 350
