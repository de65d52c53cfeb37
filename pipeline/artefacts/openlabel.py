"""Exports campaign frames for other tools: YOLO layout and COCO for all, and an ASAM OpenLABEL 1.0 file for each test."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.artefacts.dataset import Record, decode_jpeg, image_path, remove_leftovers, write_image, write_truth
from pipeline.artefacts.files import write_json
from pipeline.artefacts.tables import read_frames
from pipeline.core.boxes import Box
from pipeline.core.truth import Truth
from pipeline.errors import InputError

STREAM = "camera"


def export_frames(frames: Path, out: Path, hfov_deg: float, distortion: float) -> int:
    """Write frames.parquet as images/val, labels/val, dataset.yaml, truth.coco.json and openlabel/<test_id>.json; returns the number of
    frames.

    hfov_deg, distortion: of the camera, for OpenLABEL's intrinsics. Removes the files of an earlier export in `out`.
    """
    table = read_frames(frames).sort_values(["test_id", "step"], kind="stable").reset_index(drop=True)
    if table.empty:
        raise InputError(f"{frames} holds no frames; run the campaign with campaign.keep_every above 0")
    records = []
    for index, row in table.iterrows():
        number, image, truth = int(str(index)), decode_jpeg(row["image"]), _truth(row)
        write_image(out, "val", number, image, truth)
        records.append(
            Record("val", number, image.shape[1], image.shape[0], truth, {"test_id": row["test_id"], "step": float(row["step"])})
        )
    remove_leftovers(out, records)
    for earlier in (out / "openlabel").glob("*.json"):
        earlier.unlink()
    write_truth(out, records)
    for test, rows in table.groupby("test_id"):
        first = records[int(rows.index[0])]
        write_json(out / "openlabel" / f"{test}.json", openlabel(rows, first.width, first.height, hfov_deg, distortion))
    return len(records)


def openlabel(rows: pd.DataFrame, width: int, height: int, hfov_deg: float, distortion: float) -> dict[str, Any]:
    """The frames of one test execution in OpenLABEL's JSON: one pedestrian, with its visible and its whole box."""
    focal = width / 2 / float(np.tan(np.radians(hfov_deg) / 2))
    matrix = [focal, 0, width / 2, 0, 0, focal, height / 2, 0, 0, 0, 1, 0]
    intrinsics = {"width_px": width, "height_px": height, "camera_matrix_3x4": matrix, "distortion_coeffs_1xN": [distortion, 0, 0, 0, 0]}
    frames: dict[str, Any] = {}
    for index, row in rows.iterrows():
        uri = str(image_path(Path(), "val", int(str(index))))
        frame: dict[str, Any] = {"frame_properties": {"streams": {STREAM: {"uri": uri}}}}
        boxes = [_bbox(name, box) for name in ("visible", "whole") if (box := _box(row, name)) is not None]
        if boxes:
            numbers = [{"name": name, "val": float(row[name])} for name in ("visible_pixels", "whole_pixels", "contrast")]
            frame["objects"] = {"0": {"object_data": {"bbox": boxes, "num": numbers}}}
        frames[str(int(row["step"]))] = frame
    steps = sorted(int(step) for step in frames)
    shown = [step for step in steps if "objects" in frames[str(step)]]
    interval = [{"frame_start": shown[0], "frame_end": shown[-1]}] if shown else []
    return {
        "openlabel": {
            "metadata": {"schema_version": "1.0.0", "name": str(rows["test_id"].iloc[0]), "annotator": "Blindspot"},
            "streams": {STREAM: {"type": "camera", "stream_properties": {"intrinsics_pinhole": intrinsics}}},
            "objects": {"0": {"name": "pedestrian", "type": "Pedestrian", "frame_intervals": interval}} if shown else {},
            "frame_intervals": [{"frame_start": steps[0], "frame_end": steps[-1]}],
            "frames": frames,
        }
    }


def _bbox(name: str, box: Box) -> dict[str, Any]:
    """OpenLABEL boxes: centre x and y, width and height, pixels."""
    left, top, right, bottom = box
    return {"name": name, "stream": STREAM, "val": [(left + right) / 2, (top + bottom) / 2, right - left, bottom - top]}


def _box(row: Mapping[Any, Any] | pd.Series, name: str) -> Box | None:
    left, top, right, bottom = (float(row[f"{name}_{side}"]) for side in ("left", "top", "right", "bottom"))
    return None if np.isnan(left) else (left, top, right, bottom)


def _truth(row: pd.Series) -> Truth:
    visible, whole = _box(row, "visible"), _box(row, "whole")
    return Truth(visible, whole, int(row["visible_pixels"]), int(row["whole_pixels"]), float(row["contrast"]))
