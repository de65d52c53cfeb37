"""Draw docs/images: scenarios in every weather, people in every animation, a run from above.

Usage: python tools/pictures.py [--out FOLDER]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.commands.contact_sheet import write_picture
from pipeline.commands.top_view import SPEEDS_MPS, top_view
from pipeline.config.composing import CONF, functional_scenario
from pipeline.report.style import save_png
from pipeline.simulators.mujoco.contact_sheet import WEATHERS, crew_sheet, scenario_sheet

README_ROWS = {
    "F1": ("day", "fog 75 %"),
    "F5": ("rain 100 %",),
    "F8": ("low sun ahead",),
    "F2": ("night",),
    "F3": ("rain at night",),
    "F2star": ("day",),
    "F4star": ("dusk",),
}
"""Scenarios and weathers of the sheet in README.md."""


def main(words: Sequence[str] | None = None) -> int:
    """Render all sheets; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument(
        "--out", type=Path, default=Path("docs/images"), help="folder (default: %(default)s)"
    )
    folder: Path = parser.parse_args(words).out
    rows = []
    for name, weathers in README_ROWS.items():
        shown = {weather: WEATHERS[weather] for weather in weathers}
        rows.append(scenario_sheet(functional_scenario(name), {}, shown))
    write_jpeg(folder / "contact-sheet.jpg", np.vstack(rows), 86)
    for path in sorted((CONF / "scenario").glob("[!_]*.yaml")):
        sheet = scenario_sheet(functional_scenario(path.stem), {})
        height, width = sheet.shape[:2]
        size = width * 3 // 4, height * 3 // 4
        smaller = np.asarray(cv2.resize(sheet, size, interpolation=cv2.INTER_AREA), np.uint8)
        write_jpeg(folder / f"{path.stem}.jpg", smaller, 82)
    for stem, name in (("pedestrians", "F3"), ("pedestrians-held-out", "F3star")):
        write_jpeg(folder / f"{stem}.jpg", crew_sheet(functional_scenario(name)), 80)
    save_png(top_view(functional_scenario("F1"), SPEEDS_MPS), folder / "top-view.png")
    return 0


def write_jpeg(path: Path, image: NDArray[np.uint8], quality: int) -> None:
    """Write an RGB image as JPEG and print its size."""
    write_picture(path, image, quality)
    print(f"{path} {path.stat().st_size // 1024} KB")


if __name__ == "__main__":
    sys.exit(main())
