"""Command `contact-sheet`: a scenario in all weathers and at several distances, in one picture."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.artefacts.files import write_bytes
from pipeline.config.composing import compose, functional_scenario
from pipeline.config.project import typed
from pipeline.errors import InputError

HELP = "Draw a scenario in all weathers and at several distances."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("scenario", help="name of a file in conf/scenario, such as F1")
    parser.add_argument(
        "--out", type=typed, default="contact-sheet.png", help="the picture (default: %(default)s)"
    )


def run(options: argparse.Namespace) -> int:
    """Write the picture."""
    from pipeline.simulators.mujoco.contact_sheet import scenario_sheet

    if options.out.suffix not in (".png", ".jpg"):
        raise InputError(f"--out: a contact sheet must be a .png or a .jpg, got {options.out.name}")
    camera = compose("default", []).camera
    write_picture(options.out, scenario_sheet(functional_scenario(options.scenario), camera))
    print(options.out)
    return 0


def write_picture(path: Path, image: NDArray[np.uint8], quality: int = 95) -> None:
    """Write an image. OpenCV's own writer reports no error if it cannot write.

    Args:
        path: a .png or .jpg file.
        image: (h, w, 3) RGB.
        quality: of a JPEG, 0 to 100.
    """
    import cv2

    settings = (cv2.IMWRITE_JPEG_QUALITY, quality) if path.suffix == ".jpg" else ()
    write_bytes(path, bytes(cv2.imencode(path.suffix, image[..., ::-1], settings)[1]))
