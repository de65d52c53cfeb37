"""Command `pictures`: docs/images, every scenario in every weather, everybody in every animation, and a run from above."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.commands.contact_sheet import write_picture
from pipeline.commands.top_view import SPEEDS_MPS, top_view
from pipeline.config.composing import CONF, functional_scenario
from pipeline.config.project import typed

HELP = "Draw the pictures of the documentation."
README_ROWS = {
    "F1": ("day", "fog 75 %"),
    "F5": ("rain 100 %",),
    "F8": ("low sun ahead",),
    "F2": ("night",),
    "F3": ("rain at night",),
    "F2star": ("day",),
    "F4star": ("dusk",),
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--out", type=typed, default=Path("docs/images"), help="folder (default: %(default)s)"
    )


def run(options: argparse.Namespace) -> int:
    """Render all sheets."""
    import cv2

    from pipeline.report.style import save_png
    from pipeline.simulators.mujoco.contact_sheet import WEATHERS, crew_sheet, scenario_sheet

    rows = [
        scenario_sheet(
            functional_scenario(name), {}, {weather: WEATHERS[weather] for weather in weathers}
        )
        for name, weathers in README_ROWS.items()
    ]
    _write(options.out / "contact-sheet.jpg", np.vstack(rows), 86)
    for path in sorted((CONF / "scenario").glob("[!_]*.yaml")):
        sheet = scenario_sheet(functional_scenario(path.stem), {})
        height, width = sheet.shape[:2]
        smaller = np.asarray(
            cv2.resize(sheet, (width * 3 // 4, height * 3 // 4), interpolation=cv2.INTER_AREA),
            np.uint8,
        )
        _write(options.out / f"{path.stem}.jpg", smaller, 82)
    for stem, name in (("pedestrians", "F3"), ("pedestrians-held-out", "F3star")):
        _write(options.out / f"{stem}.jpg", crew_sheet(functional_scenario(name)), 80)
    save_png(top_view(functional_scenario("F1"), SPEEDS_MPS), options.out / "top-view.png")
    return 0


def _write(path: Path, image: NDArray[np.uint8], quality: int) -> None:
    """Write one picture, RGB, as JPEG, and print its size."""
    write_picture(path, image, quality)
    print(f"{path} {path.stat().st_size // 1024} KB")
