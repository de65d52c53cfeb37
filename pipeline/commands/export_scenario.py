"""Command `export-scenario`: one concrete scenario as OpenSCENARIO and OpenDRIVE."""

from __future__ import annotations

import argparse

from pipeline.commands.simulate import concrete_scenario
from pipeline.config.composing import functional_scenario
from pipeline.config.project import typed

HELP = "Write one concrete scenario as OpenSCENARIO and OpenDRIVE."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("scenario", help="name of a file in conf/scenario, such as F1")
    parser.add_argument(
        "words", nargs="*", metavar="key=value", help="scenario variables; others have defaults"
    )
    parser.add_argument(
        "--out",
        type=typed,
        default="scenario",
        help="name of both files, without suffix (default: %(default)s)",
    )


def run(options: argparse.Namespace) -> int:
    """Write both files."""
    from pipeline.artefacts.openscenario import write_openscenario

    described = functional_scenario(options.scenario)
    concrete = concrete_scenario(described.logical_space(), options.words)
    for path in write_openscenario(described, concrete, options.out):
        print(path)
    return 0
