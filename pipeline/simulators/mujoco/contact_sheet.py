"""Contact sheets: a scenario in every weather and at every distance, and its pedestrians."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.core.paths import Pose
from pipeline.scenarios.functional import EGO_HALF_LENGTH_M, FunctionalScenario
from pipeline.scenarios.people import population
from pipeline.simulators.mujoco import gait
from pipeline.simulators.mujoco.gait import ANIMATIONS
from pipeline.simulators.mujoco.lens import CameraSettings
from pipeline.simulators.mujoco.stage import Stage
from pipeline.simulators.mujoco.weather import Weather

Pixels = NDArray[np.uint8]
WEATHERS = {
    "day": Weather(sun_azimuth=120, sun_altitude=50),
    "low sun ahead": Weather(sun_azimuth=4, sun_altitude=9),
    "dusk": Weather(sun_azimuth=80, sun_altitude=2),
    "night": Weather(sun_azimuth=80, sun_altitude=-12),
    "fog 75 %": Weather(fog=75, sun_azimuth=200, sun_altitude=40),
    "rain 100 %": Weather(rain=100, sun_azimuth=200, sun_altitude=30),
    "rain at night": Weather(rain=80, sun_azimuth=80, sun_altitude=-12),
}
MOMENTS = (0.0, 0.4, 0.7, 0.9)
"""Shares of the time until ego and pedestrian would meet."""
LOOKS = (2, 47, 20, 71, 38, 13, 24)
"""The people of a scenario's sheet, by their place in its population."""
CREW_COLUMNS = 37


def scenario_sheet(
    scenario: FunctionalScenario,
    camera: Mapping[str, Any],
    weathers: Mapping[str, Weather] = WEATHERS,
) -> Pixels:
    """One row per weather, one column per moment of the unbraked encounter.

    Returns:
        (rows * height, columns * width, 3) RGB.
    """
    stage = Stage(scenario.town, scenario.actors, CameraSettings.model_validate(dict(camera)))
    route, rng, people = scenario.ego.route(), np.random.default_rng(0), _people(scenario)
    speed, walking = scenario.ego.speed_kmh / 3.6, 1.4
    rows = []
    try:
        for index, (name, weather) in enumerate(weathers.items()):
            tiles = []
            for moment in MOMENTS:
                time_s = moment * scenario.ego.horizon_s
                stage.reset(weather, people[LOOKS[index % len(LOOKS)]])
                stage.put("ego", route.at(scenario.start_s() + speed * time_s))
                for actor, described in scenario.actors.items():
                    stage.put(actor, described.route().at(described.travelled(time_s)))
                posture = gait.pose(
                    ANIMATIONS[index % len(ANIMATIONS)], 6 * time_s, walking, stage.walker
                )
                stage.place_pedestrian(scenario.pedestrian_pose(time_s, walking), posture)
                if not scenario.has_pedestrian:
                    stage.pedestrian.hide()
                metres = (
                    scenario.conflict_s() - scenario.start_s() - speed * time_s - EGO_HALF_LENGTH_M
                )
                tiles.append(
                    _captioned(stage.shoot(rng)[0], f"{scenario.label}  {name}  {metres:.0f} m")
                )
            rows.append(np.hstack(tiles))
    finally:
        stage.close()
    return np.vstack(rows)


def crew_sheet(scenario: FunctionalScenario) -> Pixels:
    """The scenario's 74 people in the six animations, two rows of 37 per animation."""
    stage = Stage(scenario.town, {}, CameraSettings(width=640, height=384, hfov_deg=36))
    route, rows = scenario.ego.route(), []
    try:
        ego = route.at(scenario.conflict_s() - 9)
        for row, animation in enumerate(ANIMATIONS):
            tiles = []
            for index, name in enumerate(_people(scenario)):
                stage.reset(WEATHERS["day"], name)
                stage.put("ego", ego)
                x, y = scenario.pedestrian.at
                heading = float(np.radians((90, -60, 180, 30)[index % 4]))
                stage.place_pedestrian(
                    Pose(x, y, heading), gait.pose(animation, 0.8 * index + row, 1.3, stage.walker)
                )
                image, _ = stage.shoot(np.random.default_rng(0))
                tiles.append(
                    cv2.resize(image[70:370, 235:405], (68, 120), interpolation=cv2.INTER_AREA)
                )
            rows += [
                np.hstack(tiles[i : i + CREW_COLUMNS]) for i in range(0, len(tiles), CREW_COLUMNS)
            ]
    finally:
        stage.close()
    return np.vstack(rows)


def _people(scenario: FunctionalScenario) -> tuple[str, ...]:
    """The names of the scenario's population, the first if it names none."""
    return tuple(population(scenario.people or 1))


def _captioned(image: Pixels, text: str) -> Pixels:
    tile = image.copy()
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)
    tile[: height + 10, : width + 12] = tile[: height + 10, : width + 12] // 3
    cv2.putText(
        tile, text, (6, height + 5), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255), 1, cv2.LINE_AA
    )
    return tile
