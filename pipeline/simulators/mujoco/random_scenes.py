"""Random scenes for the base training set: spawn, weather and people (thesis section 5.4)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config.sections import BaseSet, Rarity
from pipeline.core.footprints import Rectangle
from pipeline.core.paths import Path, Pose
from pipeline.core.truth import Truth
from pipeline.errors import InputError
from pipeline.scenarios.functional import (
    EGO_HALF_LENGTH_M,
    EGO_HALF_WIDTH_M,
    HALF_LENGTHS_M,
    Actor,
    VehicleKind,
)
from pipeline.scenarios.people import FIRST_RANDOM, fingerprint, population
from pipeline.scenarios.streets import END_X, LANE_WIDTH, START_X, Junction, Street, Town, streets
from pipeline.simulators.mujoco import gait
from pipeline.simulators.mujoco.gait import ANIMATIONS
from pipeline.simulators.mujoco.lens import CameraSettings
from pipeline.simulators.mujoco.stage import Stage, weather_of

PEDESTRIAN_SHARE = 0.88
BESIDE_VEHICLE_SHARE = 0.35
TURNING_SHARE = 0.4
NEAREST_M, FARTHEST_M = 2.8, 46.0
OUT_OF_SIGHT = Pose(-500, 0, 0)
FLEET: tuple[VehicleKind, ...] = (
    "bus",
    "hatchback",
    "saloon",
    "van",
    "hatchback",
    "saloon",
    "hatchback",
)


@dataclass(frozen=True)
class Scene:
    """One labelled random image.

    Attributes are its scenario variables, the town, the people, and the person's height and
    umbrella.
    """

    image: NDArray[np.uint8]
    truth: Truth
    attributes: dict[str, Any]


def scenes(
    shard: int, count: int, base_set: BaseSet, settings: CameraSettings, held_out: Mapping[str, str]
) -> Iterator[Scene]:
    """Yield `count` random scenes in one random urban town with one random population.

    A shard depends on seed, shard and rarity alone.

    All towns are urban: the suburban style is reserved for the held-out scenarios. held_out:
    fingerprint of a town or a population -> the held-out scenario that has it; InputError if the
    random town or population is among them.
    """
    rng = np.random.default_rng([base_set.seed, shard])
    town, people = _world(rng)
    for kind, drawn in (("town", town.fingerprint), ("people", fingerprint(people))):
        if drawn in held_out:
            raise InputError(
                f"base_set.seed {base_set.seed} draws the {kind} of held-out {held_out[drawn]} "
                f"for shard {shard}; choose another seed"
            )
    fleet = {
        f"vehicle{i}": Actor(kind=kind, x_m=0, y_m=0, paint=int(rng.integers(7)))
        for i, kind in enumerate(FLEET)
    }
    stage = Stage(town, fleet, settings)
    try:
        for _ in range(count):
            attributes = {"town": town.fingerprint, **_conditions(people, base_set.rare, rng)}
            yield _scene(stage, town, attributes, rng)
    finally:
        stage.close()


def _world(rng: np.random.Generator) -> tuple[Town, int]:
    """A random town and the number of a random population."""
    return _town(rng), int(rng.integers(FIRST_RANDOM, 2**31))


def _town(rng: np.random.Generator) -> Town:
    """A random urban town: half have a junction, half of the rest a bus bay, a third two lanes."""
    junction = None
    if rng.random() < 0.5:
        x_m = float(rng.uniform(-10, 40))
        junction = Junction(x_m=x_m, side="left" if rng.random() < 0.5 else "right")
    bay = (-22.0, 4.0) if junction is None and rng.random() < 0.5 else None
    vegetation = str(rng.choice(["none", "left", "right", "both"], p=[0.4, 0.1, 0.1, 0.4]))
    crosswalks = []
    if junction and rng.random() < 0.7:
        crosswalks.append({"street": "side", "at_m": float(rng.uniform(7, 12))})
    return Town.model_validate(
        {
            "style": "urban",
            "seed": int(rng.integers(1000, 2**31)),
            "lanes_ahead": 1 + int(rng.random() < 0.33),
            "junction": junction,
            "bus_bay": bay,
            "vegetation": vegetation,
            "crosswalks": tuple(crosswalks),
        }
    )


def _conditions(people: int, rare: Rarity, rng: np.random.Generator) -> dict[str, Any]:
    """Random values of the scenario variables, with what is known of the person.

    people: number of the population.
    """
    persons = population(people)
    conditions: dict[str, Any] = {
        "people": fingerprint(people),
        "rain": float(rng.uniform(0, 100)) if rng.random() < 0.7 else 0.0,
        "fog": float(rng.uniform(0, 100)) if rng.random() < 0.7 else 0.0,
        "sun_azimuth": float(rng.uniform(0, 360)),
        "sun_altitude": float(rng.uniform(-20, 90))
        if rng.random() < 0.7
        else float(rng.uniform(-8, 14)),
        "animation": _drawn(
            {name: rare.crouching if name == "crouching" else 1.0 for name in ANIMATIONS}, rng
        ),
        "blueprint": _drawn(
            {name: rare.children if person.child else 1.0 for name, person in persons.items()}, rng
        ),
        "pedestrian_speed": float(rng.uniform(0, 3)),
    }
    shown = persons[conditions["blueprint"]]
    return {**conditions, "height_m": shown.height, "umbrella": int(shown.umbrella)}


def _scene(stage: Stage, town: Town, attributes: dict[str, Any], rng: np.random.Generator) -> Scene:
    stage.reset(weather_of(attributes), attributes["blueprint"])
    ego = _ego(town, rng)
    stage.put("ego", ego)
    vehicles = _park(stage, town, ego, rng)
    if rng.random() < PEDESTRIAN_SHARE:
        x, y = _spot(ego, vehicles, rng)
        heading, phase = float(rng.uniform(-180, 180)), float(rng.uniform(0, 40))
        posture = gait.pose(
            attributes["animation"], phase, attributes["pedestrian_speed"], stage.walker
        )
        stage.place_pedestrian(Pose(x, y, float(np.radians(heading))), posture)
    else:
        stage.pedestrian.hide()
    image, truth = stage.shoot(rng)
    return Scene(image, truth, attributes)


def _drawn(frequencies: Mapping[str, float], rng: np.random.Generator) -> str:
    """One of the names, each as often as its frequency relative to the others."""
    weights = np.array(list(frequencies.values()))
    return str(rng.choice(list(frequencies), p=weights / weights.sum()))


def _ego(town: Town, rng: np.random.Generator) -> Pose:
    """A pose in a lane ahead or on the way around a corner, slightly off its centre."""
    lane = -LANE_WIDTH / 2 + LANE_WIDTH * int(rng.integers(town.lanes_ahead))
    turning, place = rng.random() < TURNING_SHARE, rng.random()
    if town.junction and turning:
        side = streets(town)[1]
        corner = side.world(0, -LANE_WIDTH / 2)[0]
        if town.junction.side == "right":
            lane = -LANE_WIDTH / 2
        path = Path(
            [(corner - 40, lane), (corner, lane), side.world(60, -LANE_WIDTH / 2)], radius=7.75
        )
        on = path.at(20 + 35 * place)
    else:
        on = Pose(START_X + 20 + 125 * place, lane, 0)
    aside, turned = rng.normal(0, 0.25), rng.normal(0, 0.02)
    return Pose(
        float(on.x - aside * np.sin(on.heading)),
        float(on.y + aside * np.cos(on.heading)),
        float(on.heading + turned),
    )


def _park(stage: Stage, town: Town, ego: Pose, rng: np.random.Generator) -> list[Rectangle]:
    """Place a random part of the fleet in front of the ego.

    Returns the footprints of the vehicles in the scene.
    """
    placed = [Rectangle(ego, EGO_HALF_LENGTH_M + 1, EGO_HALF_WIDTH_M + 0.3)]
    vehicles: list[Rectangle] = []
    network = streets(town)
    for i, kind in enumerate(FLEET):
        street = network[int(rng.random() < 0.4)] if len(network) > 1 else network[0]
        pose = _lane(street, kind, ego, rng)
        footprint = Rectangle(pose, HALF_LENGTHS_M[kind] + 0.3, 1.3 if kind == "bus" else 1.0)
        if rng.random() < 0.35 or any(footprint.overlaps(other) for other in placed):
            stage.put(f"vehicle{i}", OUT_OF_SIGHT)
            continue
        stage.put(f"vehicle{i}", pose)
        placed.append(footprint)
        vehicles.append(footprint)
    return vehicles


def _lane(street: Street, kind: VehicleKind, ego: Pose, rng: np.random.Generator) -> Pose:
    """A pose in a lane or at a kerb: 6 to 60 m ahead, or anywhere on a side street."""
    half = HALF_LENGTHS_M[kind]
    u = ego.x + rng.uniform(6, 60) + half if street.name == "main" else rng.uniform(half + 1, 60)
    oncoming = street.middle + LANE_WIDTH / 2
    if kind == "bus" and street.bay and street.bay[0] + half < u < street.bay[1] - half:
        v = -5.15
    else:
        v = rng.choice(
            [-2.6, rng.choice([-1.75, street.middle - 1.75]), oncoming, oncoming + 0.85],
            p=[0.3, 0.15, 0.35, 0.2],
        )
    v += rng.normal(0, 0.12)
    x, y = street.world(float(np.clip(u, START_X + 5, END_X)), float(v))
    return Pose(
        x, y, float(street.angle + (0 if v < street.middle else np.pi) + rng.normal(0, 0.035))
    )


def _spot(ego: Pose, vehicles: list[Rectangle], rng: np.random.Generator) -> tuple[float, float]:
    """The pedestrian's position: anywhere in view, often half hidden behind or before a vehicle."""
    c, s = np.cos(ego.heading), np.sin(ego.heading)
    for _ in range(50):
        if vehicles and rng.random() < BESIDE_VEHICLE_SHARE:
            vehicle = vehicles[rng.integers(len(vehicles))]
            ahead = float(rng.choice([-1, 1], p=[0.25, 0.75])) * (
                vehicle.half_length + float(rng.uniform(0.2, 3.7))
            )
            aside, heading = float(rng.normal(0, 1.6)), ego.heading
            x = float(vehicle.pose.x + np.cos(heading) * ahead - np.sin(heading) * aside)
            y = float(vehicle.pose.y + np.sin(heading) * ahead + np.cos(heading) * aside)
        else:
            distance = float(np.exp(rng.uniform(np.log(NEAREST_M), np.log(FARTHEST_M))))
            ahead, aside = 0.5 + distance, float(rng.uniform(-1, 1)) * min(9.0, 0.55 * distance)
            x, y = float(ego.x + c * ahead - s * aside), float(ego.y + s * ahead + c * aside)
        free = all(vehicle.distance(x, y) > 0.3 for vehicle in vehicles)
        if free and c * (x - ego.x) + s * (y - ego.y) > NEAREST_M:
            return x, y
    return float(ego.x + c * FARTHEST_M), float(ego.y + s * FARTHEST_M)
