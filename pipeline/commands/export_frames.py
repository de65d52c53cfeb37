"""Command `export-frames`: the kept frames of a campaign as YOLO, COCO, CSV and OpenLABEL."""

from __future__ import annotations

import argparse

from pipeline.config.composing import PARAMS, load
from pipeline.config.project import typed

HELP = "Write the kept frames of a campaign as YOLO, COCO, CSV and OpenLABEL."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("frames", type=typed, help="frames.parquet of a campaign")
    parser.add_argument("--out", type=typed, default="frames", help="folder (default: %(default)s)")
    parser.add_argument("--films", action="store_true", help="write a film of each failure, too")
    parser.add_argument(
        "--params",
        type=typed,
        default=PARAMS,
        help="params.yaml of the study, for its camera (default: %(default)s)",
    )


def run(options: argparse.Namespace) -> int:
    """Write the folder."""
    from pipeline.artefacts.frame_export import export_frames

    camera = load(options.params).camera
    hfov_deg, distortion = camera.get("hfov_deg", 60), camera.get("distortion", 0)
    count = export_frames(options.frames, options.out, float(hfov_deg), float(distortion))
    print(
        f"{options.out}: {count.train} frames to train, {count.val} to validate; "
        f"tests in a failure region: {count.in_regions}"
    )
    if options.films:
        from pipeline.report.films import write_films

        folder = options.out / "films"
        films = write_films(options.frames, folder, float(camera.get("rate_hz", 10)))
        print(f"{folder}: {films} films")
    return 0
