"""The MuJoCo world keeps the contract, and its physics and ground truth are right."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.core import kpi
from pipeline.core.encounter import RoadUsers
from pipeline.core.loop import run_test
from pipeline.core.space import Value
from pipeline.core.visibility import MIN_VISIBLE_PIXELS
from pipeline.detectors.scripted import BlindDetector, VisiblePixelOracle
from pipeline.scenarios.functional import EGO_HALF_LENGTH_M, FunctionalScenario
from pipeline.simulators.mujoco.world import MujocoWorld
from pipeline.testing import CAR, check_world
from tests.contracts.replays import CONF, described, signature

NAMES = sorted(path.stem for path in CONF.glob("F*.yaml"))


def man(scenario: FunctionalScenario) -> str:
    """A man of the scenario's population."""
    return scenario.logical_space().variables[-1].values[39]


@pytest.fixture(scope="module", params=NAMES)
def rendered(request: pytest.FixtureRequest) -> Any:
    scenario = described(request.param)
    world = MujocoWorld(scenario, CAR.vehicle)
    yield world, scenario.logical_space(), scenario
    world.close()


def test_the_contract_holds(rendered: Any) -> None:
    world, space, _ = rendered
    check_world(world, space, VisiblePixelOracle(), count=2)


def test_unbraked_ego_and_pedestrian_meet_at_the_conflict_point(rendered: Any) -> None:
    """Within 0.1 m and 0.05 s: extrapolated from the last row, both reach it at the horizon."""
    world, space, scenario = rendered
    concrete = space.decode(space.sample(1, np.random.default_rng(3))[0])
    concrete |= {"pedestrian_shift": 0.0, "pedestrian_speed": 1.5}
    signals = run_test(world, BlindDetector(), CAR, concrete).signals
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
    space, world = scenario.logical_space(), MujocoWorld(scenario, CAR.vehicle)
    whole: dict[str, Any] = {
        v.name: v.values[0] if v.values else np.int64(1) for v in space.variables
    }
    whole |= {"pedestrian_shift": 0, "rain": 30}
    exact = space.decode(space.encode(whole))
    kept = [
        run_test(world, BlindDetector(), CAR, concrete, keep_every=9, noise=noise).frames
        for concrete in (whole, exact)
        for noise in (None, whole, exact)
    ]
    noise = {**exact, "noise": "other"}
    other = run_test(world, BlindDetector(), CAR, exact, keep_every=9, noise=noise).frames
    world.close()
    assert not any(
        np.array_equal(a.frame.image, b.frame.image) for a, b in zip(kept[0], other, strict=True)
    )
    assert all(
        np.array_equal(a.frame.image, b.frame.image)
        for other in kept[1:]
        for a, b in zip(kept[0], other, strict=True)
    )


def positions(world: MujocoWorld, concrete: Mapping[str, Value], seconds: float) -> list[RoadUsers]:
    """The road users after each time step without braking; nothing is rendered."""
    world.reset(concrete, seed=0)
    return [world.advance(world.step_s, 0.0) for _ in range(round(seconds / world.step_s))]


def test_the_ego_follows_its_path(rendered: Any) -> None:
    world, space, scenario = rendered
    concrete = space.decode(space.sample(1, np.random.default_rng(5))[0])
    route = scenario.ego.route()
    for users in positions(world, concrete, 5.0):
        s, aside = route.project(users.ego.x, users.ego.y)
        assert abs(aside) < 1e-6
        assert route.at(s).heading == pytest.approx(users.ego.heading, abs=1e-8)


def test_speed_and_shift_move_the_pedestrian_by_their_values(rendered: Any) -> None:
    world, space, scenario = rendered
    heading = np.radians(scenario.pedestrian.heading_deg)
    concrete = space.decode(space.sample(1, np.random.default_rng(7))[0])

    def along(**changes: float) -> Any:
        """Position of the pedestrian along its path in the first second, metres."""
        poses: Any = [users.pedestrian for users in positions(world, {**concrete, **changes}, 1.0)]
        dx = np.array([pose.x for pose in poses]) - scenario.pedestrian.at[0]
        dy = np.array([pose.y for pose in poses]) - scenario.pedestrian.at[1]
        return np.cos(heading) * dx + np.sin(heading) * dy

    for speed in (0.0, 0.8, 2.6):
        place = along(pedestrian_speed=speed, pedestrian_shift=0.0)
        assert place[-1] - place[0] == pytest.approx(speed * (1.0 - world.step_s), abs=1e-6)
    shifted = [along(pedestrian_speed=1.0, pedestrian_shift=shift) for shift in (-0.5, 0.0, 0.5)]
    assert (
        np.allclose(np.abs(np.diff(shifted, axis=0)), 0.5)
        and len({float(np.sign(d)) for d in np.diff(shifted, axis=0)[:, 0]}) == 1
    )


def test_the_oracle_avoids_failure_in_plain_weather_and_in_fog(rendered: Any) -> None:
    world, _, scenario = rendered
    for fog in (0.0, 95.0):
        concrete: dict[str, Value] = {
            "rain": 0.0,
            "fog": fog,
            "sun_azimuth": 120.0,
            "sun_altitude": 45.0,
            "pedestrian_shift": 0.0,
            "pedestrian_speed": 1.5,
            "animation": "walking",
            "blueprint": man(scenario),
        }
        episode = run_test(world, VisiblePixelOracle(), CAR, concrete)
        assert not kpi.evaluate(episode.signals, 0.1).failure


@pytest.mark.parametrize("rain", [0.0, 100.0])
def test_braking_follows_the_vehicle_dynamics(rendered: Any, rain: float) -> None:
    world, space, _ = rendered
    concrete = space.decode(space.sample(1, np.random.default_rng(8))[0]) | {
        "fog": 0.0,
        "rain": rain,
        "pedestrian_speed": 0.5,
        "sun_altitude": 40.0,
    }
    signals = run_test(world, VisiblePixelOracle(), CAR, concrete).signals
    speed, brake = signals["ego_speed_mps"], signals["brake"]
    assert np.all(np.diff(speed) <= 1e-9)
    first = int(np.argmax(brake == 1.0))
    # The demand acts one frame later, the latency; after half a second the lag is over.
    assert speed[first + 1] == speed[0] and speed[first + 2] < speed[0]
    settled = next(i for i in range(6, len(brake)) if np.all(brake[i - 6 : i + 1] == 1.0))
    deceleration = 9.81 * (0.6 if rain else 0.8)
    assert (speed[settled] - speed[settled + 1]) / 0.1 == pytest.approx(deceleration, rel=0.02)


def test_the_whole_box_contains_the_visible_one(rendered: Any) -> None:
    (world, space, _), both = rendered, 0
    for point in space.sample(2, np.random.default_rng(4)):
        episode = run_test(world, BlindDetector(), CAR, space.decode(point), keep_every=2)
        for kept in episode.frames:
            truth = kept.frame.truth
            assert truth.visible_pixels <= truth.whole_pixels
            if truth.visible_box and truth.whole_box:
                assert np.all(np.array(truth.whole_box[:2]) <= truth.visible_box[:2])
                assert np.all(np.array(truth.whole_box[2:]) >= truth.visible_box[2:])
                both += 1
    assert both > 0


def test_occluded_scenarios_show_the_pedestrian_later_than_open_ones() -> None:
    """A running pedestrian by day shows late behind the bus and around the corner."""
    seen = {}
    for name in ("F1", "F1star", "F6", "F7", "F3", "F4", "F3star", "F4star"):
        scenario = described(name)
        world = MujocoWorld(scenario, CAR.vehicle)
        concrete: dict[str, Value] = {
            "rain": 0.0,
            "fog": 0.0,
            "sun_azimuth": 120.0,
            "sun_altitude": 45.0,
            "pedestrian_shift": 0.0,
            "pedestrian_speed": 2.5,
            "animation": "walking",
            "blueprint": man(scenario),
        }
        signals = run_test(world, BlindDetector(), CAR, concrete).signals
        world.close()
        hidden = np.flatnonzero(
            np.asarray(signals["visible_pixels"][:-1], int) < MIN_VISIBLE_PIXELS
        )
        seen[name] = float(signals["time_s"][hidden[-1] + 1]) if len(hidden) else 0.0
        assert signals["visible_pixels"][-2] > 500
    assert (
        min(seen[name] for name in ("F1", "F1star", "F6", "F7"))
        > max(seen[name] for name in ("F3", "F4", "F3star", "F4star")) + 0.5
    )


def test_a_replay_in_another_process_gives_the_same_bits(tmp_path: Path) -> None:
    scenario = described("F2")
    space = scenario.logical_space()
    points = space.sample(3, np.random.default_rng(6))
    # In this order, night, dusk and rain would change the lamps if episodes shared state.
    concretes = [
        space.decode(p) | {"sun_altitude": a, "rain": r}
        for p, a, r in zip(points, (-12.0, -0.5, 40.0), (0.0, 0.0, 90.0), strict=True)
    ]
    world = MujocoWorld(scenario, CAR.vehicle)
    here = [signature(world, concrete) for concrete in concretes]
    world.close()
    program = (
        "import json, sys; sys.path.insert(0, sys.argv[1])\n"
        "from pipeline.simulators.mujoco.world import MujocoWorld\n"
        "from pipeline.testing import CAR\n"
        "from tests.contracts.replays import described, signature\n"
        "concretes = json.load(sys.stdin); world = MujocoWorld(described('F2'), CAR.vehicle)\n"
        "print(json.dumps([signature(world, c) for c in reversed(concretes)]))"
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
