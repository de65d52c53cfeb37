"""Random scenes for the base training set: spawn anyone anywhere in any weather (thesis section 5.4)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.protocols import Truth
from pipeline.scenario import Actor, Town, VehicleKind

from .blueprints import NAMES
from .gait import ANIMATIONS
from .stage import CameraSettings, Stage, weather_of
from .vehicles import HALF_LENGTHS

PEDESTRIAN_SHARE = 0.88
BESIDE_VEHICLE_SHARE = 0.35
NEAREST_M, FARTHEST_M = 2.8, 46.0
OUT_OF_SIGHT_X = -500.0
FLEET: tuple[VehicleKind, ...] = ("bus", "hatchback", "saloon", "van", "hatchback", "saloon", "hatchback")
HALF_WIDTH_M = 1.3


@dataclass(frozen=True)
class Scene:
    """One labelled random image; attributes are its scenario variables."""

    image: NDArray[np.uint8]
    truth: Truth
    attributes: dict[str, Any]


def scenes(shard: int, count: int, seed: int, settings: CameraSettings) -> Iterator[Scene]:
    """Yield `count` random scenes in one random urban town; a shard depends on (seed, shard) alone.

    Only the urban style is shown: the suburban town of the held-out scenarios stays unseen.
    """
    rng = np.random.default_rng([seed, shard])
    bay = (-22.0, 4.0) if rng.random() < 0.5 else None
    town = Town(style="urban", seed=int(rng.integers(1000, 2**31)), bus_bay=bay, vegetation=bool(rng.random() < 0.5))
    fleet = {f"vehicle{i}": Actor(kind=kind, x_m=0, y_m=0, paint=int(rng.integers(7))) for i, kind in enumerate(FLEET)}
    stage = Stage(town, fleet, settings)
    try:
        for _ in range(count):
            yield _scene(stage, town, rng)
    finally:
        stage.close()


def _scene(stage: Stage, town: Town, rng: np.random.Generator) -> Scene:
    attributes: dict[str, Any] = {
        "rain": float(rng.uniform(0, 100)) if rng.random() < 0.7 else 0.0,
        "fog": float(rng.uniform(0, 100)) if rng.random() < 0.7 else 0.0,
        "sun_azimuth": float(rng.uniform(0, 360)),
        "sun_altitude": float(rng.uniform(-20, 90)) if rng.random() < 0.7 else float(rng.uniform(-8, 14)),
        "animation": str(rng.choice(ANIMATIONS)),
        "blueprint": str(rng.choice(NAMES)),
        "pedestrian_speed": float(rng.uniform(0, 3)),
    }
    stage.reset(weather_of(attributes), attributes["blueprint"])
    ego_x, ego_y = float(rng.uniform(-55, 70)), float(-1.75 + rng.normal(0, 0.25))
    stage.place_ego(ego_x, ego_y)
    vehicles = _park(stage, town, ego_x, rng)
    if rng.random() < PEDESTRIAN_SHARE:
        x, y = _spot(ego_x, ego_y, vehicles, rng)
        heading, phase = float(rng.uniform(-180, 180)), float(rng.uniform(0, 40))
        stage.place_pedestrian(x, y, heading, attributes["animation"], phase, attributes["pedestrian_speed"])
    else:
        stage.pedestrian.hide()
    image, truth = stage.shoot(rng)
    return Scene(image, truth, attributes)


def _park(stage: Stage, town: Town, ego_x: float, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """Place a random part of the fleet ahead of the ego; returns (x, y, half length) of each vehicle that is in the scene."""
    placed: list[tuple[float, float, float]] = []
    for i, kind in enumerate(FLEET):
        half = HALF_LENGTHS[kind]
        x = ego_x + float(rng.uniform(6, 60)) + half
        in_bay = kind == "bus" and town.bus_bay is not None and town.bus_bay[0] + half < x < town.bus_bay[1] - half
        lane = -5.15 if in_bay else float(rng.choice([-2.6, -1.75, 1.75, 2.6], p=[0.3, 0.15, 0.35, 0.2]))
        y = lane + float(rng.normal(0, 0.15))
        crowded = any(abs(x - other_x) < half + other + 0.8 and abs(y - other_y) < 2 * HALF_WIDTH_M for other_x, other_y, other in placed)
        if crowded or rng.random() < 0.35:
            stage.place_actor(f"vehicle{i}", OUT_OF_SIGHT_X, 0, 0)
            continue
        stage.place_actor(f"vehicle{i}", x, y, (0 if y < 0 else 180) + float(rng.normal(0, 2)))
        placed.append((x, y, half))
    return placed


def _spot(ego_x: float, ego_y: float, vehicles: list[tuple[float, float, float]], rng: np.random.Generator) -> tuple[float, float]:
    """Where the pedestrian stands: anywhere in view, or often close behind or in front of a vehicle, half hidden."""
    for _ in range(50):
        if vehicles and rng.random() < BESIDE_VEHICLE_SHARE:
            x, y, half = vehicles[rng.integers(len(vehicles))]
            x += float(rng.choice([-1, 1], p=[0.25, 0.75])) * (half + float(rng.uniform(0.5, 4)))
            y += float(rng.normal(0, 1.6))
        else:
            distance = float(np.exp(rng.uniform(np.log(NEAREST_M), np.log(FARTHEST_M))))
            x = ego_x + 0.5 + distance
            y = ego_y + float(rng.uniform(-1, 1)) * min(9.0, 0.55 * distance)
        free = all(abs(x - vx) > half + 0.4 or abs(y - vy) > HALF_WIDTH_M for vx, vy, half in vehicles)
        if free and x - ego_x > NEAREST_M:
            return x, y
    return ego_x + FARTHEST_M, ego_y
