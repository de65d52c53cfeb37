"""Command `contact-sheet`: a scenario in all weathers and at several distances, in one picture."""

from __future__ import annotations

import argparse

from pipeline.config.composing import compose, functional_scenario
from pipeline.config.project import typed
from pipeline.errors import InputError

HELP = "Draw a scenario in all weathers and at several distances."


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", help="name of a file in conf/scenario, such as F1")
    parser.add_argument("--out", type=typed, default="contact-sheet.png", help="the picture (default: %(default)s)")


def run(options: argparse.Namespace) -> int:
    """Write the picture."""
    import cv2

    from pipeline.simulators.mujoco.contact_sheet import scenario_sheet

    if options.out.suffix not in (".png", ".jpg"):
        raise InputError(f"--out: a contact sheet must be a .png or a .jpg, got {options.out.name}")
    camera = compose("default", []).simulator.get("camera", {})
    cv2.imwrite(str(options.out), scenario_sheet(functional_scenario(options.scenario), camera)[..., ::-1])
    print(options.out)
    return 0
