"""Draws the pictures of docs/scenarios.md and of the README: every scenario in every weather, every pedestrian in every animation.

python docs/contact_sheet.py
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.config.composing import CONF, functional_scenario
from pipeline.simulators.mujoco.contact_sheet import WEATHERS, crew_sheet, scenario_sheet

IMAGES = Path(__file__).resolve().parent / "images"
README_ROWS = {
    "F1": ("day", "fog 75 %"),
    "F5": ("rain 100 %",),
    "F8": ("low sun ahead",),
    "F2": ("night",),
    "F3": ("rain at night",),
    "F2star": ("day",),
    "F4star": ("dusk",),
}


def write(name: str, image: NDArray[np.uint8], quality: int = 82) -> None:
    """Write one picture, RGB, as JPEG."""
    path = IMAGES / f"{name}.jpg"
    cv2.imwrite(str(path), image[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, quality))
    print(f"{path} {path.stat().st_size // 1024} KB")


def main() -> None:
    """Render all sheets."""
    IMAGES.mkdir(exist_ok=True)
    readme = [
        scenario_sheet(functional_scenario(name), {}, {weather: WEATHERS[weather] for weather in weathers})
        for name, weathers in README_ROWS.items()
    ]
    write("contact-sheet", np.vstack(readme), 86)
    for path in sorted((CONF / "scenario").glob("[!_]*.yaml")):
        sheet = scenario_sheet(functional_scenario(path.stem), {})
        height, width = sheet.shape[:2]
        write(path.stem, np.asarray(cv2.resize(sheet, (width * 3 // 4, height * 3 // 4), interpolation=cv2.INTER_AREA), np.uint8))
    write("pedestrians", crew_sheet(functional_scenario("F3star")), 80)


if __name__ == "__main__":
    main()
