"""Single snapshots of the front-car domain (Cheng et al., section 5).

A point fixes the conditions, everything else is random.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.paths import Pose
from pipeline.core.space import Value
from pipeline.core.truth import Truth
from pipeline.errors import SimulationError
from pipeline.scenarios.functional import EGO_HALF_LENGTH_M, HALF_LENGTHS_M, Actor, VehicleKind
from pipeline.scenarios.people import population
from pipeline.scenarios.streets import LANE_WIDTH, Street, Town, streets
from pipeline.simulators.mujoco import gait
from pipeline.simulators.mujoco.lens import CameraSettings
from pipeline.simulators.mujoco.pedestrian import GROUP
from pipeline.simulators.mujoco.stage import Stage
from pipeline.simulators.mujoco.weather import Weather

CLASSES = (
    "sky",
    "road",
    "lane marking",
    "pavement",
    "terrain",
    "building",
    "vegetation",
    "street furniture",
    "pedestrian",
    "other vehicle",
    "forward vehicle",
    "oncoming vehicle",
)
"""Classes of the segmentation, by number."""
MATERIALS = {
    "road": "road",
    "marking": "lane marking",
    "pavement": "pavement",
    "kerb": "pavement",
    "grass": "terrain",
    "gravel": "terrain",
    "leaves": "vegetation",
    "hedge": "vegetation",
    "wall": "building",
    "ground": "building",
    "roof": "building",
    "window_light": "building",
}
"""Class of a surface by the prefix of its material's name; all other surfaces are street
furniture."""
FLEET: tuple[VehicleKind, ...] = (
    "hatchback",
    "saloon",
    "estate",
    "suv",
    "van",
    "hatchback",
    "saloon",
    "estate",
)
FORWARD_M, ONCOMING_M = (6.0, 42.0), (8.0, 55.0)
"""Gap in metres: distance from the ego's middle to theirs, minus half of each length."""
RADII_M = (70.0, 180.0)
"""Curvatures of curvy roads."""
LAY_BY = (0.0, 60.0)
BESIDE_SHARE, PEDESTRIAN_SHARE = 0.6, 0.4
MIN_PIXELS = 40
"""A vehicle with fewer visible pixels counts as absent."""
DRAWS = 40
AWAY = Pose(-500, 0, 0)
PEOPLE = 1
"""The population on the pavements."""
Point = Mapping[str, str]


@dataclass(frozen=True)
class Snapshot:
    """One labelled image.

    Attributes:
        image: (h, w, 3) RGB.
        classes: (h, w) numbers of CLASSES.
        truth: the forward vehicle.
        attributes: the point and its weather.
    """

    image: NDArray[np.uint8]
    classes: NDArray[np.uint8]
    truth: Truth
    attributes: dict[str, Value]


def snapshots(
    town_seed: int, shots: list[tuple[Point, tuple[int, ...]]], settings: CameraSettings
) -> Iterator[Snapshot]:
    """Yield a snapshot for each point and seed, all in one town.

    The points must agree on lanes and lane orientation. A snapshot depends only on the town, its
    point and its own seed.
    """
    rng = np.random.default_rng(town_seed)
    town = _town(shots[0][0], rng)
    fleet = {
        f"vehicle{i}": Actor(kind=kind, x_m=0, y_m=0, paint=int(rng.integers(7)))
        for i, kind in enumerate(FLEET)
    }
    stage = Stage(town, fleet, settings)
    photographer = _Photographer(stage, streets(town)[0])
    try:
        for point, seed in shots:
            yield photographer.shoot(point, np.random.default_rng(seed))
    finally:
        stage.close()


def _town(point: Point, rng: np.random.Generator) -> Town:
    radius = float(rng.uniform(*RADII_M)) * (1 if rng.random() < 0.5 else -1)
    return Town(
        seed=int(rng.integers(1000, 2**31)),
        lanes_ahead=int(point["lanes"]),
        curvature_1pm=1 / radius if point["lane_orientation"] == "curvy" else 0.0,
        bus_bay=LAY_BY if rng.random() < 0.6 else None,
        vegetation="both" if rng.random() < 0.4 else "none",
    )


class _Photographer:
    """Arranges and photographs scenes on one stage."""

    def __init__(self, stage: Stage, street: Street) -> None:
        self._stage, self._street = stage, street
        self._surfaces = _surfaces(stage)
        self._people = tuple(population(PEOPLE))
        model = stage.model
        self._body_of: dict[str, int] = {}
        for i in range(len(FLEET)):
            self._body_of[f"vehicle{i}"] = int(model.body(f"vehicle{i}").rootid[0])
        self._root = model.body_rootid[model.geom_bodyid]

    def shoot(self, point: Point, rng: np.random.Generator) -> Snapshot:
        """Draw arrangements of the point until each vehicle that it names is visible."""
        weather = _weather(point["weather"], rng)
        for _ in range(DRAWS):
            self._stage.reset(weather, str(rng.choice(self._people)))
            forward, oncoming = self._arrange(point, rng)
            image, _ = self._stage.shoot(rng)
            classes = self._stage.camera.segment(self._classes(forward, oncoming))
            shown = []
            for which in ("forward", "oncoming"):
                pixels = (classes == CLASSES.index(f"{which} vehicle")).sum()
                shown.append(bool(pixels >= MIN_PIXELS))
            if shown == [forward is not None, oncoming is not None]:
                truth = self._stage.camera.truth_of(
                    image, classes == CLASSES.index("forward vehicle")
                )
                return Snapshot(
                    image,
                    classes,
                    truth,
                    {**point, "rain": weather.rain, "fog": weather.fog, "clouds": weather.clouds},
                )
        raise SimulationError(f"no arrangement of {DRAWS} shows the vehicles of {dict(point)}")

    def _arrange(self, point: Point, rng: np.random.Generator) -> tuple[str | None, str | None]:
        """Place everyone; returns the names of the forward and of the oncoming vehicle."""
        stage, street = self._stage, self._street
        lane = -LANE_WIDTH / 2 + LANE_WIDTH * (int(point["current_lane"]) - 1)
        u = float(rng.uniform(-45, 45))
        stage.put("ego", self._pose(u, lane + rng.normal(0, 0.15), rng))
        names = [f"vehicle{i}" for i in rng.permutation(len(FLEET))]
        for name in names:
            stage.put(name, AWAY)
        forward = names.pop() if point["forward_vehicle"] == "present" else None
        if forward:
            stage.put(
                forward,
                self._pose(u + self._gap(forward, FORWARD_M, rng), lane + rng.normal(0, 0.2), rng),
            )
        oncoming = names.pop() if point["oncoming_vehicle"] == "present" else None
        if oncoming:
            left = street.middle + LANE_WIDTH / 2 + rng.normal(0, 0.2)
            stage.put(
                oncoming,
                self._pose(u + self._gap(oncoming, ONCOMING_M, rng), left, rng, turned=np.pi),
            )
        self._others(names, point, u, rng)
        return forward, oncoming

    def _others(self, names: list[str], point: Point, u: float, rng: np.random.Generator) -> None:
        """Place a car in the next lane, cars in the lay-by and a person on the pavement."""
        stage, street = self._stage, self._street
        if point["lanes"] == "2" and rng.random() < BESIDE_SHARE:
            beside = LANE_WIDTH / 2 if point["current_lane"] == "1" else -LANE_WIDTH / 2
            name = names.pop()
            stage.put(
                name,
                self._pose(u + self._gap(name, FORWARD_M, rng), beside + rng.normal(0, 0.2), rng),
            )
        if street.bay:
            for place in np.arange(street.bay[0] + 5, street.bay[1] - 4, 7.5):
                if names and rng.random() < 0.4:
                    stage.put(names.pop(), self._pose(float(place), -(street.right + 1.6), rng))
        if rng.random() < PEDESTRIAN_SHARE:
            side, ahead = int(rng.choice([-1, 1])), u + float(rng.uniform(8, 40))
            spot = street.pose(
                ahead, side * (street.edge(side, ahead) + float(rng.uniform(0.6, 2.4)))
            )
            heading, phase = float(rng.uniform(-180, 180)), float(rng.uniform(0, 40))
            where = Pose(spot.x, spot.y, float(np.radians(heading)))
            stage.place_pedestrian(
                where, gait.pose(str(rng.choice(gait.ANIMATIONS)), phase, 1.2, stage.walker)
            )
        else:
            stage.pedestrian.hide()

    def _gap(self, name: str, limits: tuple[float, float], rng: np.random.Generator) -> float:
        """Metres along the street from the ego's middle to that of a vehicle."""
        half = HALF_LENGTHS_M[FLEET[int(name.removeprefix("vehicle"))]]
        return half + EGO_HALF_LENGTH_M + float(np.exp(rng.uniform(*np.log(limits))))

    def _pose(self, u: float, v: float, rng: np.random.Generator, turned: float = 0.0) -> Pose:
        pose = self._street.pose(u, v)
        return Pose(pose.x, pose.y, float(pose.heading + turned + rng.normal(0, 0.015)))

    def _classes(self, forward: str | None, oncoming: str | None) -> NDArray[np.uint8]:
        classes = self._surfaces.copy()
        for name, label in ((forward, "forward vehicle"), (oncoming, "oncoming vehicle")):
            if name:
                classes[self._root == self._body_of[name]] = CLASSES.index(label)
        return classes


def _surfaces(stage: Stage) -> NDArray[np.uint8]:
    """(ngeom,) class of each geom of the model, vehicles all `other`."""
    model = stage.model
    classes = np.full(model.ngeom, CLASSES.index("street furniture"), np.uint8)
    for geom in range(model.ngeom):
        body = model.body(model.body_rootid[model.geom_bodyid[geom]]).name
        if body.startswith("vehicle"):
            classes[geom] = CLASSES.index("other vehicle")
        elif model.geom_group[geom] == GROUP:
            classes[geom] = CLASSES.index("pedestrian")
        elif model.geom_matid[geom] >= 0:
            material = model.mat(model.geom_matid[geom]).name
            label = next(
                (label for start, label in MATERIALS.items() if material.startswith(start)),
                "street furniture",
            )
            classes[geom] = CLASSES.index(label)
    return classes


def _weather(name: str, rng: np.random.Generator) -> Weather:
    """A day's weather of a kind."""
    azimuth, altitude = float(rng.uniform(0, 360)), float(rng.uniform(8, 75))
    if name == "sunny":
        return Weather(0, 0, azimuth, altitude, clouds=float(rng.uniform(0, 25)))
    if name == "cloudy":
        return Weather(
            0, float(rng.uniform(0, 15)), azimuth, altitude, clouds=float(rng.uniform(75, 100))
        )
    return Weather(float(rng.uniform(30, 100)), 0, azimuth, altitude)
