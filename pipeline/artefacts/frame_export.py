"""Exports campaign frames for other tools.

It writes YOLO's layout, COCO and CSV for all, and an ASAM OpenLABEL 1.0 file for each test.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pipeline.artefacts.dataset import (
    Record,
    decode_jpeg,
    image_path,
    remove_leftovers,
    write_image,
    write_truth,
)
from pipeline.artefacts.files import write_bytes, write_json
from pipeline.artefacts.frame_tags import NOTHING, splits_of, tags_of_tests
from pipeline.artefacts.openlabel import Camera, openlabel
from pipeline.artefacts.tables import frame_truth, read_frames
from pipeline.core.space import Value
from pipeline.errors import InputError

TABLE = "frames.csv"


@dataclass(frozen=True)
class Exported:
    """The numbers of frames by split, and of tests in a failure region."""

    train: int
    val: int
    in_regions: int


def export_frames(frames: Path, out: Path, hfov_deg: float, distortion: float) -> Exported:
    """Write frames.parquet as images/, labels/ and dataset.yaml (YOLO), truth.coco.json, frames.csv
    and openlabel/<test_id>.json.

    Args:
        frames: the table.
        out: a new folder or that of an earlier export, whose files are removed.
        hfov_deg: horizontal field of view of the camera, degrees.
        distortion: first radial coefficient of the camera.

    Raises:
        InputError: if `out` holds anything else, which an export could overwrite.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: expected a folder to write in, got a file; choose another --out")
    if not (out / TABLE).exists() and out.exists() and any(out.iterdir()):
        raise InputError(
            f"{out}: expected a new folder or that of an earlier export, got other files; choose "
            "another --out"
        )
    table = (
        read_frames(frames).sort_values(["test_id", "step"], kind="stable").reset_index(drop=True)
    )
    if table.empty:
        raise InputError(
            f"{frames} holds no frames; run the campaign with campaign.keep_every above 0"
        )
    write_bytes(out / TABLE, b"")  # After a kill, it says whose the folder is.
    tags, splits = tags_of_tests(frames), splits_of(list(table["test_id"].unique()))
    records = []
    for index, row in table.iterrows():
        number, image, test = int(str(index)), decode_jpeg(row["image"]), str(row["test_id"])
        shown: dict[str, Value] = {"test_id": test, "step": float(row["step"])}
        records.append(
            Record(
                splits[test],
                number,
                image.shape[1],
                image.shape[0],
                frame_truth(row),
                shown,
                tags.get(test, NOTHING),
            )
        )
        write_image(out, records[-1].split, number, image, records[-1].truth)
    remove_leftovers(out, records)
    write_truth(out, records)
    _write_table(out, table, records)
    _write_openlabel(
        out, table, records, Camera(records[0].width, records[0].height, hfov_deg, distortion)
    )
    tests = {str(record.attributes["test_id"]): record for record in records}
    validation = sum(record.split == "val" for record in records)
    return Exported(
        len(records) - validation,
        validation,
        sum(bool(record.tags["region"]) for record in tests.values()),
    )


def _write_table(out: Path, table: pd.DataFrame, records: list[Record]) -> None:
    """A row for each frame: its file, its test's tags and its own columns."""
    files = pd.DataFrame(
        [
            {"file": image_path(Path(), r.split, r.index).as_posix(), "split": r.split, **r.tags}
            for r in records
        ]
    )
    columns = table.drop(columns="image")
    ordered = pd.concat(
        [files[["file", "split"]], columns, files.drop(columns=["file", "split"])], axis=1
    )
    write_bytes(
        out / TABLE, ordered.to_csv(index=False, lineterminator="\n", float_format="%.6g").encode()
    )


def _write_openlabel(out: Path, table: pd.DataFrame, records: list[Record], camera: Camera) -> None:
    for earlier in (out / "openlabel").glob("*.json"):
        earlier.unlink()
    for test, rows in table.groupby("test_id"):
        images = {
            int(str(index)): image_path(
                Path(), records[int(str(index))].split, int(str(index))
            ).as_posix()
            for index in rows.index
        }
        write_json(out / "openlabel" / f"{test}.json", openlabel(rows, images, camera))
