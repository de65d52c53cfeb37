"""Checkers of the three protocols: `check_detector(MyDetector())` in a test is enough.

Each raises an AssertionError that names the violated rule.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.core.braking import Aeb, Vehicle
from pipeline.core.car import Car
from pipeline.core.detections import Detections
from pipeline.core.encounter import Encounter, RoadUsers
from pipeline.core.episode import Episode, Frame
from pipeline.core.interfaces import Observation
from pipeline.core.loop import run_test
from pipeline.core.matching import COCO
from pipeline.core.space import Floats, Space
from pipeline.core.truth import Truth
from pipeline.protocols import Detector, Sampler, World

CAR = Car(
    Vehicle(dry_friction=0.8, wet_friction=0.6, build_up_s=0.1, latency_s=0.1),
    Aeb("truth", "confidence", brakes_from=0.0, votes=1, window=1, margin_m=0.8),
    COCO,
)
"""A car that brakes for every detection of the pedestrian, for tests of worlds."""


def check_sampler(factory: Callable[[], Sampler], space: Space, batches: int = 4) -> None:
    """Check bounds, determinism, an `ask` without side effects, and a restart from the history.

    Args:
        factory: makes a fresh sampler with the same seed over `space`.
        space: its variables and constraints.
        batches: number of batches to ask for.

    Raises:
        AssertionError: names the violated rule.

    >>> from pipeline.core.samplers.random import RandomSampler
    >>> percent = {"kind": "continuous", "unit": "%", "low": 0, "high": 100, "step": 10}
    >>> space = Space.from_dict({"rain": percent, "fog": percent})
    >>> check_sampler(lambda: RandomSampler(space, seed=0), space)
    """
    sampler = factory()
    history: list[tuple[Floats, Floats]] = []
    for _ in range(batches):
        points = sampler.ask()
        assert points.ndim == 2 and points.shape[1] == len(space), (
            f"ask must return (b, {len(space)}), got {points.shape}"
        )
        assert len(points) > 0 or history, "the first ask must return at least one point"
        if not len(points):  # The campaign ends.
            break
        for column, variable in zip(points.T, space.variables, strict=True):
            low, high = variable.low, variable.high
            if variable.kind == "categorical":
                low, high = 0, variable.size - 1
            inside = np.isfinite(column).all() and (column >= low).all() and (column <= high).all()
            assert inside, "ask must stay within the space"
        assert space.violation(points) is None, "ask must keep the constraints"
        assert np.array_equal(points, sampler.ask()), (
            "ask twice without tell must give the same points"
        )
        # A made-up KPI with a failure region and an error.
        values = np.where(points[:, 0] > np.median(points[:, 0]), 0.05, 1.0)
        values[0] = np.nan
        copy = points.copy()
        sampler.tell(points, values)
        assert np.array_equal(points, copy), "tell must not change its points"
        history.append((points, values))
    restored = _told(factory(), history)
    assert np.array_equal(sampler.ask(), restored.ask()), (
        "a sampler that is told the same history must continue like the first one"
    )
    if not getattr(sampler, "learns", True):
        errors = [(points, np.full_like(values, np.nan)) for points, values in history]
        assert np.array_equal(sampler.ask(), _told(factory(), errors).ask()), (
            "a sampler whose `learns` is False must ignore results"
        )


def _told(sampler: Sampler, history: list[tuple[Floats, Floats]]) -> Sampler:
    for points, values in history:
        sampler.tell(points, values)
    return sampler


def check_world(world: World, space: Space, detector: Detector, count: int = 3) -> None:
    """Check that a world keeps time, brakes, fits its images, and repeats a test to the last bit.

    Args:
        world: the world, made for a scenario.
        space: the scenario's variables; `count` random points of it are executed.
        detector: any; one that brakes checks more of the world.
        count: number of concrete scenarios.

    Raises:
        AssertionError: names the violated rule.

    >>> from pipeline.detectors.scripted import BlindDetector
    >>> from pipeline.simulators.analytic import AnalyticWorld
    >>> percent = {"kind": "continuous", "unit": "%", "low": 0, "high": 100, "step": 10}
    >>> altitude = {"kind": "continuous", "unit": "deg", "low": -20, "high": 90, "step": 10}
    >>> speed = {"kind": "continuous", "unit": "m/s", "low": 0, "high": 3, "step": 0.25}
    >>> animation = {"kind": "categorical", "values": ["walking", "stumble"]}
    >>> variables = {"rain": percent, "fog": percent, "sun_altitude": altitude}
    >>> variables |= {"pedestrian_speed": speed, "animation": animation}
    >>> check_world(AnalyticWorld(), Space.from_dict(variables), BlindDetector())
    """
    steps = world.frame_s / world.step_s
    assert steps >= 1 and np.isclose(steps, round(steps)), (
        f"frame_s must be a multiple of step_s, got {world.frame_s:g} s and {world.step_s:g} s"
    )
    concretes = [space.decode(point) for point in space.sample(count, np.random.default_rng(0))]
    for concrete in concretes:
        encounter = world.reset(concrete, seed=1)
        assert isinstance(encounter, Encounter), (
            f"reset must return pipeline.core.encounter.Encounter, got {type(encounter).__name__}"
        )
        _check_motion(world)
    episodes = [run_test(world, detector, CAR, concrete, keep_every=4) for concrete in concretes]
    # The other order shows what one test leaves behind for the next.
    for concrete, episode in zip(reversed(concretes), reversed(episodes), strict=True):
        _check_same(episode, run_test(world, detector, CAR, concrete, keep_every=4))


def _check_motion(world: World) -> None:
    """Check a second of full braking after `reset`."""
    users = _observed(world)
    assert users == _observed(world), "observe must not move the road users"
    assert users.time_s == 0, f"the time after reset must be 0 s, got {users.time_s:g} s"
    assert users.ego_speed_mps > 0, "the ego must drive at the start"
    for _ in range(round(1 / world.step_s)):
        before, users = users, world.advance(world.step_s, -8.0)
        assert isinstance(users, RoadUsers), (
            f"advance must return pipeline.core.encounter.RoadUsers, got {type(users).__name__}"
        )
        seconds = users.time_s - before.time_s
        assert abs(seconds - world.step_s) < 1e-6, (
            f"advance must take {world.step_s:g} s, took {seconds:g} s"
        )
        assert 0 <= users.ego_speed_mps <= before.ego_speed_mps + 1e-9, (
            "the ego must not become faster under a negative acceleration, nor drive backwards"
        )
    assert users == _observed(world), "advance and observe must report the same road users"
    for _ in range(round(1 / world.step_s)):
        driven = world.advance(world.step_s, 2.0)
    assert driven.ego_speed_mps > users.ego_speed_mps, (
        "the ego must become faster under a positive acceleration"
    )


def _observed(world: World) -> RoadUsers:
    seen = world.observe()
    assert isinstance(seen, Observation), (
        f"observe must return pipeline.protocols.Observation, got {type(seen).__name__}"
    )
    size = (world.camera.height, world.camera.width, 3)
    assert seen.image.dtype == np.uint8 and seen.image.shape == size, (
        f"images must be {size} uint8, as `camera` says, got {seen.image.shape} {seen.image.dtype}"
    )
    for box in (seen.truth.visible_box, seen.truth.whole_box):
        if box is not None:
            left, top, right, bottom = box
            assert 0 <= left < right <= size[1] and 0 <= top < bottom <= size[0], (
                f"boxes of the truth must be left, top, right, bottom in the image, got {box}"
            )
    return seen.users


def _check_same(episode: Episode, replay: Episode) -> None:
    for name, column in episode.signals.items():
        is_number = column.dtype.kind == "f"
        assert np.array_equal(column, replay.signals[name], equal_nan=is_number), (
            f"signal {name} must be the same in a replay"
        )
    for kept, again in zip(episode.frames, replay.frames, strict=True):
        assert np.array_equal(kept.frame.image, again.frame.image), (
            f"frame {kept.step} must be the same in a replay"
        )


def check_detector(detector: Detector, width: int, height: int) -> None:
    """Check that a detector is deterministic, leaves the image unchanged and reports boxes in it.

    Args:
        detector: the detector.
        width: of the images, pixels.
        height: of the images, pixels.

    Raises:
        AssertionError: names the violated rule.

    >>> from pipeline.detectors.scripted import VisiblePixelOracle
    >>> check_detector(VisiblePixelOracle(), 64, 48)
    """
    noise = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    figure = np.full((height, width, 3), 90, np.uint8)
    figure[height // 3 : 2 * height // 3, width // 2 - 8 : width // 2 + 8] = 220
    box = (width / 2 - 8, height / 3, width / 2 + 8, 2 * height / 3)
    pixels = 16 * height // 3
    truth = Truth(box, None, pixels, pixels, contrast=130.0)
    for image in (np.zeros_like(noise), noise, figure):
        before = image.copy()
        detections, repeated = (detector.detect(Frame(image, truth)) for _ in range(2))
        assert isinstance(detections, Detections), (
            "detect must return pipeline.core.detections.Detections, "
            f"got {type(detections).__name__}"
        )
        assert np.array_equal(image, before), "detect must not change the image"
        same_boxes = np.array_equal(detections.boxes, repeated.boxes)
        assert same_boxes and np.array_equal(detections.scores, repeated.scores), (
            "detect must be deterministic"
        )
        left, top, right, bottom = detections.boxes.T
        assert (right > left).all() and (bottom > top).all(), (
            "boxes must be left, top, right, bottom"
        )
        assert (right > 0).all() and (left < width).all(), "boxes must touch the image"
        assert (bottom > 0).all() and (top < height).all(), "boxes must touch the image"
