"""Command `compose`: conf/ and overrides to params.yaml."""

from __future__ import annotations

import argparse

from pipeline.artefacts.files import check_output, write_bytes
from pipeline.config.composing import PARAMS, compose, dump
from pipeline.config.project import typed
from pipeline.errors import InputError

HELP = "Compose conf/ into params.yaml."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "words",
        nargs="+",
        metavar="study=NAME",
        help="the study, then Hydra overrides such as campaign.tests=100",
    )
    parser.add_argument("--out", type=typed, default=PARAMS, help="the file (default: %(default)s)")


def run(options: argparse.Namespace) -> int:
    """Write the file and name its study."""
    words: list[str] = options.words
    study = [word.removeprefix("study=") for word in words if word.startswith("study=")]
    if len(study) != 1:
        raise InputError(f"name one study, as in `compose study=default`; got {' '.join(words)}")
    check_output(options.out)
    config = compose(study[0], [word for word in words if not word.startswith("study=")])
    write_bytes(options.out, dump(config, f"python -m pipeline compose {' '.join(words)}").encode())
    print(f"{options.out}: study {config.study}")
    return 0
