"""Checkers of the three protocols, for any adapter: `check_detector(MyDetector())` in a test is enough."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline.core import kpi
from pipeline.core.braking import Aeb, Vehicle
from pipeline.core.car import Car
from pipeline.core.detections import Detections
from pipeline.core.episode import Episode, Frame
from pipeline.core.matching import COCO, Criterion, match
from pipeline.core.space import Floats, Space
from pipeline.core.truth import Truth
from pipeline.protocols import Detector, Sampler, Simulator

CAR = Car(
    Vehicle(0.8, 0.6, 0.1, 0.1),
    Aeb("truth", "confidence", 0.0, votes=1, window=1, margin_m=0.8),
    COCO,
)
"""A car that brakes for every detection of the pedestrian, for tests of simulators."""


def check_sampler(factory: Callable[[], Sampler], space: Space, batches: int = 4) -> None:
    """Check bounds, determinism, `ask` without side effects, and that telling the history again restores a sampler.

    factory: makes a fresh sampler with the same seed over `space`. AssertionError names the violated rule.
    """
    low = np.array([0 if v.kind == "categorical" else v.low for v in space.variables])
    high = np.array([v.size - 1 if v.kind == "categorical" else v.high for v in space.variables])
    first = factory()
    history: list[tuple[Floats, Floats]] = []
    for _ in range(batches):
        points = first.ask()
        assert points.ndim == 2 and points.shape[1] == len(space), (
            f"ask must return (b, {len(space)}), got {points.shape}"
        )
        assert len(points) > 0 or history, "the first ask must return at least one point"
        if not len(points):  # The campaign ends.
            break
        assert np.isfinite(points).all() and (points >= low).all() and (points <= high).all(), (
            "ask must stay within the space"
        )
        assert space.violation(points) is None, "ask must keep the constraints"
        assert np.array_equal(points, first.ask()), (
            "ask twice without tell must give the same points"
        )
        # A made-up KPI with a failure region and an error.
        values = np.where(points[:, 0] > (low[0] + high[0]) / 2, 0.05, 1.0)
        values[0] = np.nan
        copy = points.copy()
        first.tell(points, values)
        assert np.array_equal(points, copy), "tell must not change its points"
        history.append((points, values))
    again = factory()
    for points, values in history:
        again.tell(points, values)
    assert np.array_equal(first.ask(), again.ask()), (
        "a sampler that is told the same history must continue like the first one"
    )
    if not getattr(first, "learns", True):
        untold = factory()
        for points, values in history:
            untold.tell(points, np.full_like(values, np.nan))
        assert np.array_equal(first.ask(), untold.ask()), (
            "a sampler whose `learns` is False must ignore results"
        )


def check_simulator(
    simulator: Simulator,
    space: Space,
    detector: Detector,
    count: int = 3,
    criterion: Criterion = COCO,
) -> None:
    """Check that a test execution depends only on concrete scenario and detector, and that its signals are consistent.

    criterion: of the simulator's car.

    AssertionError names the violated rule.
    """
    concretes = [space.decode(point) for point in space.sample(count, np.random.default_rng(0))]
    episodes = [simulator.execute(concrete, detector, keep_every=4) for concrete in concretes]
    for concrete, episode in zip(reversed(concretes), reversed(episodes), strict=True):
        again = simulator.execute(concrete, detector, keep_every=4)
        for name, column in episode.signals.items():
            assert np.array_equal(
                column, again.signals[name], equal_nan=column.dtype.kind == "f"
            ), f"signal {name} must be the same in a replay"
        for one, other in zip(episode.frames, again.frames, strict=True):
            assert np.array_equal(one.frame.image, other.frame.image), (
                f"frame {one.step} must be the same in a replay"
            )
        _check_episode(episode, criterion)
    assert not simulator.execute(concretes[0], detector).frames, "keep_every=0 must keep no frame"


def _check_episode(episode: Episode, criterion: Criterion) -> None:
    signals: dict[str, Any] = dict(episode.signals)
    assert (np.diff(signals["time_s"]) > 0).all(), "time_s must increase"
    assert ((signals["brake"] >= 0) & (signals["brake"] <= 1)).all(), "brake must be in [0, 1]"
    for name in ("gap_m", "conflict_distance_m"):  # Without a pedestrian, there is no gap.
        assert not (signals[name] < 0).any(), f"{name} must not be negative"
    assert np.array_equal(signals["ttc_s"], kpi.ttc(signals), equal_nan=True), (
        "ttc_s must follow from the other signals (Eq. 5.2)"
    )
    assert len(episode.detections) in (len(signals["time_s"]), len(signals["time_s"]) - 1), (
        "every frame must give its detections"
    )
    kinds = ("far", "localisation", "duplicate")
    assert np.array_equal(
        signals["false_positives"], sum(signals[f"false_positives_{kind}"] for kind in kinds)
    ), "false positives must add up"
    for kept in episode.frames:
        image = kept.frame.image
        assert kept.matching == match(kept.detections, kept.frame.truth, criterion), (
            f"frame {kept.step} must carry the matching of its detections"
        )
        assert image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3, (
            "images must be (h, w, 3) uint8"
        )


def check_detector(detector: Detector, width: int, height: int) -> None:
    """Check that a detector is deterministic, leaves the image unchanged and reports boxes that overlap it.

    width, height: image size in pixels. AssertionError names the violated rule.
    """
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    figure = np.full((height, width, 3), 90, np.uint8)
    figure[height // 3 : 2 * height // 3, width // 2 - 8 : width // 2 + 8] = 220
    truth = Truth(
        (width / 2 - 8, height / 3, width / 2 + 8, 2 * height / 3),
        None,
        16 * height // 3,
        16 * height // 3,
        130.0,
    )
    for image in (np.zeros_like(noise), noise, figure):
        before = image.copy()
        found, again = (detector.detect(Frame(image, truth)) for _ in range(2))
        assert isinstance(found, Detections), (
            f"detect must return pipeline.core.detections.Detections, got {type(found).__name__}"
        )
        assert np.array_equal(image, before), "detect must not change the image"
        assert np.array_equal(found.boxes, again.boxes) and np.array_equal(
            found.scores, again.scores
        ), "detect must be deterministic"
        left, top, right, bottom = found.boxes.T
        assert (right > left).all() and (bottom > top).all(), (
            "boxes must be left, top, right, bottom"
        )
        assert (
            (right > 0).all()
            and (left < width).all()
            and (bottom > 0).all()
            and (top < height).all()
        ), "boxes must touch the image"
