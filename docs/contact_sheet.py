"""Draws docs/images/contact-sheet.jpg: the three scenarios in six kinds of weather and at three distances.

python docs/contact_sheet.py
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.config import compose
from pipeline.scenario import FunctionalScenario
from pipeline.simulators.mujoco.stage import CameraSettings, Stage
from pipeline.simulators.mujoco.weather import Weather

ROOT = Path(__file__).resolve().parents[1]
WEATHERS = {
    "day": Weather(sun_azimuth=120, sun_altitude=50),
    "low sun ahead": Weather(sun_azimuth=4, sun_altitude=9),
    "dusk": Weather(sun_azimuth=80, sun_altitude=2),
    "night": Weather(sun_azimuth=80, sun_altitude=-12),
    "fog 75 %": Weather(fog=75, sun_azimuth=200, sun_altitude=40),
    "rain 100 %": Weather(rain=100, sun_azimuth=200, sun_altitude=30),
}
DISTANCES_M = (6.0, 13.0, 24.0)
LOOKS = ("W 03", "M 11", "W 21", "M 35", "M 02", "W 14")
ANIMATIONS = ("walking", "texting", "drunk", "crouching", "limping", "stumble")
SCALE = 1.25


def row(stage: Stage, described: FunctionalScenario, index: int, name: str) -> NDArray[np.uint8]:
    """One weather: the pedestrian crosses in front of the ego at each distance."""
    tiles, rng = [], np.random.default_rng(index)
    side = np.sign(np.sin(np.radians(described.pedestrian.heading_deg)))
    for distance in DISTANCES_M:
        stage.reset(WEATHERS[name], LOOKS[index])
        stage.place_ego(-distance - 2.5, described.ego.lane_y_m)
        for actor, pose in described.actors.items():
            stage.place_actor(actor, pose.x_m, pose.y_m, pose.heading_deg)
        y = described.ego.lane_y_m - side * 0.06 * distance
        stage.place_pedestrian(0, y, described.pedestrian.heading_deg, ANIMATIONS[index], 0.9 + index, 1.4)
        image, _ = stage.shoot(rng)
        tile = cv2.resize(image, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_CUBIC)
        cv2.putText(
            tile, f"{described.label}  {name}  {distance:.0f} m", (7, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (255, 255, 255), 1, cv2.LINE_AA
        )
        tiles.append(tile)
    return np.hstack(tiles)


def main() -> None:
    """Render the sheet: F1 and F2 share the weathers, F1* shows day and night."""
    rows = []
    for scenario_name, names in (
        ("F1", ("day", "low sun ahead", "fog 75 %")),
        ("F2", ("dusk", "night", "rain 100 %")),
        ("F1star", ("day", "night")),
    ):
        described = compose("default", []).scenarios[scenario_name]
        stage = Stage(described.town, described.actors, CameraSettings())
        rows += [row(stage, described, list(WEATHERS).index(name), name) for name in names]
        stage.close()
    path = ROOT / "docs" / "images" / "contact-sheet.jpg"
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), np.vstack(rows)[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, 88))
    print(path)


if __name__ == "__main__":
    main()
