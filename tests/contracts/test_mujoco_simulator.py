"""The MuJoCo world keeps the simulator's contract, and its physics and ground truth are right."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import yaml

from pipeline.core import kpi
from pipeline.core.detections import Detections
from pipeline.core.paths import Pose
from pipeline.core.space import Value
from pipeline.core.visibility import MIN_VISIBLE_PIXELS
from pipeline.detectors.scripted import BlindDetector, VisiblePixelOracle
from pipeline.scenarios.functional import EGO_HALF_LENGTH_M, FunctionalScenario
from pipeline.simulators.mujoco.lens import CameraSettings
from pipeline.simulators.mujoco.simulator import MujocoSimulator, _Loop, _State
from pipeline.simulators.mujoco.world import CAMERA_X_M, CAMERA_Z_M
from pipeline.testing import CAR, check_simulator

CONF = Path(__file__).resolve().parents[2] / "conf" / "scenario"
NAMES = sorted(path.stem for path in CONF.glob("F*.yaml"))


def described(name: str) -> FunctionalScenario:
    plain = {
        **yaml.safe_load((CONF / "_space.yaml").read_text()),
        **yaml.safe_load((CONF / f"{name}.yaml").read_text()),
    }
    del plain["defaults"]
    return FunctionalScenario.model_validate_json(json.dumps(plain))


def man(scenario: FunctionalScenario) -> str:
    """A man of the scenario's population."""
    return scenario.logical_space().variables[-1].values[39]


@pytest.fixture(scope="module", params=NAMES)
def world(request: pytest.FixtureRequest) -> Any:
    scenario = described(request.param)
    simulator = MujocoSimulator(scenario, CAR)
    yield simulator, scenario.logical_space(), scenario
    simulator.close()


def test_the_contract_holds(world: Any) -> None:
    simulator, space, _ = world
    check_simulator(simulator, space, VisiblePixelOracle(), count=2)


def test_unbraked_ego_and_pedestrian_meet_at_the_conflict_point(world: Any) -> None:
    """Within 0.1 m and 0.05 s: extrapolated from the last row, both reach the conflict point at the horizon."""
    simulator, space, scenario = world
    concrete = space.decode(space.sample(1, np.random.default_rng(3))[0])
    concrete |= {"pedestrian_shift": 0.0, "pedestrian_speed": 1.5}
    signals = simulator.execute(concrete, BlindDetector()).signals
    assert signals["contact"][-1]
    left_s = scenario.ego.horizon_s - signals["time_s"][-1]
    route = scenario.ego.route()
    front = route.project(signals["ego_x_m"][-1], signals["ego_y_m"][-1])[0] + EGO_HALF_LENGTH_M
    speed = signals["ego_speed_mps"][-1]
    assert speed == pytest.approx(scenario.ego.speed_kmh / 3.6)
    assert (scenario.conflict_s() - front) / speed == pytest.approx(left_s, abs=0.05)
    heading = np.radians(scenario.pedestrian.heading_deg)
    x = signals["pedestrian_x_m"][-1] + 1.5 * left_s * np.cos(heading)
    y = signals["pedestrian_y_m"][-1] + 1.5 * left_s * np.sin(heading)
    assert np.hypot(x - scenario.pedestrian.at[0], y - scenario.pedestrian.at[1]) < 0.1


def test_the_python_type_of_a_number_changes_nothing() -> None:
    scenario = described("F1")
    space, simulator = scenario.logical_space(), MujocoSimulator(scenario, CAR)
    whole: dict[str, Any] = {
        v.name: v.values[0] if v.values else np.int64(1) for v in space.variables
    }
    whole |= {"pedestrian_shift": 0, "rain": 30}
    exact = space.decode(space.encode(whole))
    kept = [
        simulator.execute(one, BlindDetector(), 9, noise).frames
        for one in (whole, exact)
        for noise in (None, whole, exact)
    ]
    other = simulator.execute(exact, BlindDetector(), 9, {**exact, "noise": "other"}).frames
    simulator.close()
    assert not any(
        np.array_equal(a.frame.image, b.frame.image) for a, b in zip(kept[0], other, strict=True)
    )
    assert all(
        np.array_equal(a.frame.image, b.frame.image)
        for other in kept[1:]
        for a, b in zip(kept[0], other, strict=True)
    )


def test_the_ego_follows_its_path(world: Any) -> None:
    simulator, space, scenario = world
    signals = simulator.execute(
        space.decode(space.sample(1, np.random.default_rng(5))[0]), BlindDetector()
    ).signals
    route = scenario.ego.route()
    for x, y, heading in zip(
        signals["ego_x_m"], signals["ego_y_m"], signals["ego_heading_deg"], strict=True
    ):
        s, aside = route.project(x, y)
        assert abs(aside) < 1e-6 and np.degrees(route.at(s).heading) == pytest.approx(
            heading, abs=1e-6
        )


def test_speed_and_shift_move_the_pedestrian_by_their_values(world: Any) -> None:
    simulator, space, scenario = world
    heading = np.radians(scenario.pedestrian.heading_deg)
    concrete = space.decode(space.sample(1, np.random.default_rng(7))[0])

    def along(**changes: float) -> Any:
        """Position of the pedestrian along its path in the first second, metres from the conflict point."""
        signals = simulator.execute({**concrete, **changes}, BlindDetector()).signals
        dx, dy = (
            signals["pedestrian_x_m"][:11] - scenario.pedestrian.at[0],
            signals["pedestrian_y_m"][:11] - scenario.pedestrian.at[1],
        )
        return np.cos(heading) * dx + np.sin(heading) * dy

    for speed in (0.0, 0.8, 2.6):
        place = along(pedestrian_speed=speed, pedestrian_shift=0.0)
        assert place[-1] - place[0] == pytest.approx(speed, abs=1e-6)
    shifted = [along(pedestrian_speed=1.0, pedestrian_shift=shift) for shift in (-0.5, 0.0, 0.5)]
    assert (
        np.allclose(np.abs(np.diff(shifted, axis=0)), 0.5)
        and len({float(np.sign(d)) for d in np.diff(shifted, axis=0)[:, 0]}) == 1
    )


def test_the_oracle_avoids_failure_in_plain_weather_and_in_fog(world: Any) -> None:
    simulator, _, scenario = world
    for fog in (0.0, 95.0):
        concrete: dict[str, Value] = {
            "rain": 0.0, "fog": fog, "sun_azimuth": 120.0, "sun_altitude": 45.0, "pedestrian_shift": 0.0, "pedestrian_speed": 1.5,
            "animation": "walking", "blueprint": man(scenario),
        }  # fmt: skip
        episode = simulator.execute(concrete, VisiblePixelOracle())
        assert not kpi.evaluate(episode.signals, 0.1).failure


@pytest.mark.parametrize("rain", [0.0, 100.0])
def test_braking_follows_the_vehicle_dynamics(world: Any, rain: float) -> None:
    simulator, space, _ = world
    concrete = space.decode(space.sample(1, np.random.default_rng(8))[0]) | {
        "fog": 0.0,
        "rain": rain,
        "pedestrian_speed": 0.5,
        "sun_altitude": 40.0,
    }
    signals = simulator.execute(concrete, VisiblePixelOracle()).signals
    speed, brake = signals["ego_speed_mps"], signals["brake"]
    assert np.all(np.diff(speed) <= 1e-9)
    first = int(np.argmax(brake == 1.0))
    # The demand acts one frame later, the latency; after half a second of full braking the lag is over.
    assert speed[first + 1] == speed[0] and speed[first + 2] < speed[0]
    settled = next(i for i in range(6, len(brake)) if np.all(brake[i - 6 : i + 1] == 1.0))
    deceleration = 9.81 * (0.6 if rain else 0.8)
    assert (speed[settled] - speed[settled + 1]) / 0.1 == pytest.approx(deceleration, rel=0.02)


def test_the_whole_box_contains_the_visible_one(world: Any) -> None:
    (simulator, space, _), both = world, 0
    for point in space.sample(2, np.random.default_rng(4)):
        for kept in simulator.execute(space.decode(point), BlindDetector(), keep_every=2).frames:
            truth = kept.frame.truth
            assert truth.visible_pixels <= truth.whole_pixels
            if truth.visible_box and truth.whole_box:
                assert np.all(np.array(truth.whole_box[:2]) <= truth.visible_box[:2])
                assert np.all(np.array(truth.whole_box[2:]) >= truth.visible_box[2:])
                both += 1
    assert both > 0


def test_occluded_scenarios_show_the_pedestrian_later_than_open_ones() -> None:
    """A running pedestrian by day: behind the bus and around the corner it shows late, on the open road from the start."""
    seen = {}
    for name in ("F1", "F1star", "F6", "F7", "F3", "F4", "F3star", "F4star"):
        scenario = described(name)
        simulator = MujocoSimulator(scenario, CAR)
        concrete: dict[str, Value] = {
            "rain": 0.0, "fog": 0.0, "sun_azimuth": 120.0, "sun_altitude": 45.0, "pedestrian_shift": 0.0, "pedestrian_speed": 2.5,
            "animation": "walking", "blueprint": man(scenario),
        }  # fmt: skip
        signals = simulator.execute(concrete, BlindDetector()).signals
        simulator.close()
        hidden = np.flatnonzero(
            np.asarray(signals["visible_pixels"][:-1], int) < MIN_VISIBLE_PIXELS
        )
        seen[name] = float(signals["time_s"][hidden[-1] + 1]) if len(hidden) else 0.0
        assert signals["visible_pixels"][-2] > 500
    assert (
        min(seen[name] for name in ("F1", "F1star", "F6", "F7"))
        > max(seen[name] for name in ("F3", "F4", "F3star", "F4star")) + 0.5
    )


@pytest.mark.parametrize(
    ("margin_m", "in_path"), [(0.34, [False, True, False]), (0.35, [True, True, False])]
)
def test_a_detection_is_in_the_path_up_to_the_margin(margin_m: float, in_path: list[bool]) -> None:
    """In a left turn with a radius of 9 m, the road 5 m ahead lies hypot(9, 5) - 9 = 1.296 m to the right of the path.

    3 m further to the left it lies 1.19 m to the left, 1.5 m further to the right 2.63 m to the right of the path.
    """
    scenario, focal_px = described("F5"), 240.0
    space, route = scenario.logical_space(), scenario.ego.route()
    concrete = space.decode(space.sample(1, np.random.default_rng(0))[0])
    car = replace(CAR, aeb=replace(CAR.aeb, margin_m=margin_m))
    loop = _Loop(Mock(camera=Mock(focal_px=focal_px)), scenario, car, concrete, CameraSettings())
    per_metre = focal_px / (5 - CAMERA_X_M)
    boxes = [
        (160 + x - 4, 60, 160 + x + 4, 96 + CAMERA_Z_M * per_metre)
        for x in (0, -3 * per_metre, 1.5 * per_metre)
    ]
    found = Detections(np.array(boxes, np.float32), np.array([0.9, 0.8, 0.7], np.float32))
    turning = 62.75 + 9 * np.pi * 3 / 16  # In the middle of the turn, which begins after 62.75 m.
    state = _State(0.0, turning, route.at(turning), 0.0, Pose(0, 0, 0))
    assert loop._in_path(found, state).tolist() == in_path


def test_a_replay_in_another_process_gives_the_same_bits(tmp_path: Path) -> None:
    scenario = described("F2")
    space = scenario.logical_space()
    points = space.sample(3, np.random.default_rng(6))
    # In this order, night, dusk and rain would change the lamps if episodes shared state.
    concretes = [
        space.decode(p) | {"sun_altitude": a, "rain": r}
        for p, a, r in zip(points, (-12.0, -0.5, 40.0), (0.0, 0.0, 90.0), strict=True)
    ]
    simulator = MujocoSimulator(scenario, CAR)
    here = [_signature(simulator, concrete) for concrete in concretes]
    simulator.close()
    program = (
        "import json, sys; sys.path.insert(0, sys.argv[1])\n"
        "from tests.contracts.test_mujoco_simulator import CAR, MujocoSimulator, _signature, described\n"
        "concretes = json.load(sys.stdin); simulator = MujocoSimulator(described('F2'), CAR)\n"
        "print(json.dumps([_signature(simulator, c) for c in reversed(concretes)]))"
    )
    root = str(Path(__file__).resolve().parents[2])
    done = subprocess.run(
        [sys.executable, "-c", program, root],
        input=json.dumps(concretes),
        text=True,
        capture_output=True,
        check=True,
        cwd=root,
    )
    assert json.loads(done.stdout.splitlines()[-1]) == here[::-1]


def _signature(simulator: MujocoSimulator, concrete: dict[str, Any]) -> list[Any]:
    episode = simulator.execute(concrete, VisiblePixelOracle(), keep_every=1)
    images = [int(kept.frame.image.astype(np.int64).sum()) for kept in episode.frames]
    return [
        images,
        kpi.evaluate(episode.signals, 0.1).adj_ttc_s.hex(),
        episode.signals["contrast"].tolist(),
    ]
