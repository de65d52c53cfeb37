"""The closed loop, with the simplest world: a straight road, an ego and a standing pedestrian."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from pipeline.core import kpi
from pipeline.core.braking import GateKind
from pipeline.core.car import Car
from pipeline.core.detections import Detections
from pipeline.core.encounter import Encounter, RoadUsers
from pipeline.core.episode import Frame
from pipeline.core.ground import Pinhole
from pipeline.core.interfaces import Observation
from pipeline.core.loop import run_test, seed_of
from pipeline.core.matching import match
from pipeline.core.paths import Path, Pose
from pipeline.core.truth import Truth
from pipeline.core.variable import Value
from pipeline.testing import CAR

BOX = (28.0, 20.0, 36.0, 40.0)
TRUTH = Truth(BOX, BOX, 160, 160, 50.0)
ASIDE = (2.0, 2.0, 12.0, 30.0)


@dataclass
class Road:
    """The ego drives at 10 m/s towards a pedestrian 30 m ahead; its box never changes."""

    camera: Pinhole = field(default_factory=lambda: Pinhole(64, 48, 60, 0, 1.4))
    frame_s: float = 0.1
    step_s: float = 0.025
    accelerations: list[float] = field(default_factory=list)
    seed: int = -1

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        self.seed, self.users = seed, RoadUsers(0.0, 0.0, Pose(0, 0, 0), 10.0, Pose(32.5, 0, 0))
        return Encounter(Path([(0, 0), (1, 0)]), 32.5, np.pi / 2, True, 2.5, 1.0)

    def observe(self) -> Observation:
        return Observation(np.zeros((48, 64, 3), np.uint8), TRUTH, self.users)

    def advance(self, seconds: float, acceleration_mps2: float) -> RoadUsers:
        self.accelerations.append(acceleration_mps2)
        users = self.users
        s, time_s = users.travelled_m + users.ego_speed_mps * seconds, users.time_s + seconds
        speed = max(0.0, users.ego_speed_mps + acceleration_mps2 * seconds)
        self.users = replace(
            users, time_s=round(time_s, 9), travelled_m=s, ego=Pose(s, 0, 0), ego_speed_mps=speed
        )
        return self.users


class Fixed:
    """Detects the same boxes in every frame."""

    def __init__(self, *boxes: tuple[float, ...], score: float = 0.5) -> None:
        self._boxes = np.array(boxes, np.float32).reshape(-1, 4)
        self._scores = np.full(len(boxes), score, np.float32)

    def detect(self, frame: Frame) -> Detections:
        return Detections(self._boxes, self._scores)


def test_unbraked_the_ego_hits_the_pedestrian() -> None:
    world = Road()
    signals = run_test(world, Fixed(), CAR, {}).signals
    assert set(world.accelerations) == {0} and signals["contact"].tolist() == [False] * 30 + [True]
    # The disc of 0.25 m is reached after 2.975 s, in the middle of a frame.
    assert signals["time_s"][-1] == pytest.approx(2.975) and signals["gap_m"][-1] == 0
    assert np.allclose(np.diff(signals["time_s"][:-1]), 0.1)


def test_a_demand_is_the_score_and_acts_after_the_latency() -> None:
    world = Road()
    signals = run_test(world, Fixed(BOX), CAR, {}).signals
    full = 0.8 * 9.81
    assert (signals["brake"][:-1] == 0.5).all() and signals["brake"][-1] == 0
    assert signals["demand_mps2"][0] == pytest.approx(0.5 * full)
    assert world.accelerations[:4] == [0] * 4, "the latency is one frame"
    assert np.allclose(world.accelerations[4:], -0.5 * full)


@pytest.mark.parametrize(
    ("gate", "box", "brakes"),
    [
        ("truth", BOX, True),
        ("truth", ASIDE, False),
        ("detections", BOX, True),
        ("detections", ASIDE, False),
    ],
)
def test_the_car_brakes_for_what_passes_the_gate(
    gate: GateKind, box: tuple[float, ...], brakes: bool
) -> None:
    car = replace(CAR, aeb=replace(CAR.aeb, gate=gate))
    episode = run_test(Road(), Fixed(box), car, {})
    assert episode.signals["brake"].any() == brakes
    assert all(frame.in_path.tolist() == [box == BOX] for frame in episode.detections)


def test_the_signals_follow_from_each_other() -> None:
    episode = run_test(Road(), Fixed(BOX, ASIDE), CAR, {}, keep_every=4)
    signals = episode.signals
    assert np.array_equal(signals["ttc_s"], kpi.ttc(signals), equal_nan=True)
    assert len(episode.detections) == len(signals["time_s"]) - 1, "the last row has no frame"
    assert signals["false_positives"].sum() == signals["false_positives_far"].sum() > 0
    assert [kept.step for kept in episode.frames] == list(range(0, len(episode.detections), 4))
    for kept in episode.frames:
        assert kept.matching == match(kept.detections, kept.frame.truth, CAR.criterion)


def test_the_seed_depends_on_the_values_alone() -> None:
    seeds = []
    concretes: list[tuple[dict[str, Value], dict[str, Value] | None]] = [
        ({"rain": 1.0, "animation": "walking"}, None),
        ({"animation": "walking", "rain": 1}, None),
        ({"rain": 2.0, "animation": "walking"}, {"rain": 1.0, "animation": "walking"}),
        ({"rain": 2.0, "animation": "walking"}, None),
    ]
    for concrete, noise in concretes:
        world = Road()
        run_test(world, Fixed(), CAR, concrete, noise=noise)
        seeds.append(world.seed)
    assert seeds[0] == seeds[1] == seeds[2] != seeds[3]
    assert seeds[0] == seed_of({"rain": 1.0, "animation": "walking"}) and 0 <= seeds[0] < 2**64


def test_another_car_drives_otherwise() -> None:
    careful: Car = replace(CAR, aeb=replace(CAR.aeb, brakes_from=0.6))
    assert not run_test(Road(), Fixed(BOX, score=0.5), careful, {}).signals["brake"].any()
    assert run_test(Road(), Fixed(BOX, score=0.7), careful, {}).signals["brake"].any()


class LosesIt(Fixed):
    """Detects the pedestrian in the first five frames."""

    def detect(self, frame: Frame) -> Detections:
        return super().detect(frame) if frame.time_s < 0.45 else Detections.none()


def test_seen_lost_accelerated_and_hit() -> None:
    """The thesis' Fig. 7.6c: at 3.924 m/s² for half a second, the ego loses 1.962 of 10 m/s."""
    ended = {}
    for cruise in ("keep", "hold"):
        world, car = Road(), replace(CAR, vehicle=replace(CAR.vehicle, cruise=cruise))
        signals = run_test(world, LosesIt(BOX), car, {}).signals
        assert signals["lost"].tolist() == [False] * 5 + [True] * (len(signals["lost"]) - 6) + [
            False
        ]
        assert np.allclose(world.accelerations[:24], [0] * 4 + [-3.924] * 20)
        assert signals["ego_speed_mps"][6] == pytest.approx(8.038)
        if cruise == "keep":
            assert set(world.accelerations[24:]) == {0}
        else:  # 2.5 m/s³ in steps of 0.025 s, until 1 s at the acceleration would make up for it.
            assert np.allclose(world.accelerations[24:44], np.arange(1, 21) * 0.0625)
            assert max(world.accelerations) < 2 and signals["ego_speed_mps"].max() <= 10
        ended[cruise] = kpi.evaluate(signals, 0.1)
    assert {test.failure_mode for test in ended.values()} == {"contact"}
    assert ended["keep"].impact_speed_mps == pytest.approx(8.038)
    assert ended["hold"].impact_speed_mps > 9
    assert (ended["keep"].cause, ended["hold"].cause) == ("too_late", "lost_after_detection")


def test_braking_overrules_the_cruise_control() -> None:
    car = replace(CAR, vehicle=replace(CAR.vehicle, cruise="hold"))
    world = Road()
    run_test(world, Fixed(BOX), car, {})
    assert max(world.accelerations) == 0
