"""Command `verify`: compares the files of a study with the digests in their stamps."""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.artefacts import stamps
from pipeline.artefacts.folders import Folders
from pipeline.config.composing import PARAMS, load
from pipeline.config.project import typed
from pipeline.core.names import count_of
from pipeline.errors import InputError

HELP = (
    "Check the study's files against their digests. "
    "The stamps of damaged files are removed, so the next run makes the files again."
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--params",
        type=typed,
        default=PARAMS,
        help="params.yaml of the study (default: %(default)s)",
    )
    parser.add_argument(
        "--folder", type=typed, help="folder of a study (default: that of --params)"
    )


def run(options: argparse.Namespace) -> int:
    """Verify the study; returns 1 if a file is damaged."""
    if options.folder and not options.folder.is_dir():
        raise InputError(
            f"--folder: expected the folder of a study, found no folder {options.folder}"
        )
    folder = options.folder or Path(Folders(load(options.params)).root)
    if withdraw_damaged(folder):
        return 1
    written = filter(None, map(stamps.read, folder.rglob(f"*{stamps.SUFFIX}")))
    stamped = sum(len(stamp.digests) for stamp in written)
    if options.folder and not stamped:
        raise InputError(
            f"--folder: expected the folder of a study, found no stamped file in {folder}"
        )
    checked = f"{count_of(stamped, 'stamped file')}, none damaged"
    print(f"{folder}: {checked if stamped else 'not made yet, so nothing to verify'}")
    return 0


def withdraw_damaged(folder: Path) -> int:
    """Print each damaged file below a folder and withdraw its stamp; returns their number."""
    damaged = list(stamps.damaged(folder))
    for file, stamp in damaged:
        print(f"{file}: damaged or edited; the next run makes it again", flush=True)
        stamps.withdraw(stamp)
        # Snakemake removes files before it makes them, but no folders in their place.
        if file.is_dir():
            stamps.remove(file)
    return len(damaged)
