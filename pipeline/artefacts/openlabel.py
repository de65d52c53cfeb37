"""The frames of a test execution as ASAM OpenLABEL 1.0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.artefacts.tables import frame_box

STREAM = "camera"


@dataclass(frozen=True)
class Camera:
    """The camera of the images.

    Attributes:
        width, height: of its images, pixels.
        hfov_deg: its horizontal field of view.
        distortion: its first radial coefficient.
    """

    width: int
    height: int
    hfov_deg: float
    distortion: float


def openlabel(rows: pd.DataFrame, images: Mapping[int, str], camera: Camera) -> dict[str, Any]:
    """The frames of one test execution in OpenLABEL's JSON.

    They show one pedestrian, with its visible and its whole box.

    Args:
        images: the file of each row, by the row's index.
    """
    width, height, distortion = camera.width, camera.height, camera.distortion
    focal = width / 2 / float(np.tan(np.radians(camera.hfov_deg) / 2))
    matrix = [focal, 0, width / 2, 0, 0, focal, height / 2, 0, 0, 0, 1, 0]
    intrinsics = {
        "width_px": width,
        "height_px": height,
        "camera_matrix_3x4": matrix,
        "distortion_coeffs_1xN": [distortion, 0, 0, 0, 0],
    }
    frames: dict[str, Any] = {}
    for index, row in rows.iterrows():
        frame: dict[str, Any] = {
            "frame_properties": {"streams": {STREAM: {"uri": images[int(str(index))]}}}
        }
        boxes = []
        for name in ("visible", "whole"):
            box = frame_box(row, name)
            if box is not None:
                left, top, right, bottom = box
                # OpenLABEL's boxes: centre, width and height.
                val = [(left + right) / 2, (top + bottom) / 2, right - left, bottom - top]
                boxes.append({"name": name, "stream": STREAM, "val": val})
        if boxes:
            numbers = [
                {"name": name, "val": float(row[name])}
                for name in ("visible_pixels", "whole_pixels", "contrast")
            ]
            frame["objects"] = {"0": {"object_data": {"bbox": boxes, "num": numbers}}}
        frames[str(int(row["step"]))] = frame
    steps = sorted(int(step) for step in frames)
    shown = [step for step in steps if "objects" in frames[str(step)]]
    return {
        "openlabel": {
            "metadata": {
                "schema_version": "1.0.0",
                "name": str(rows["test_id"].iloc[0]),
                "annotator": "Blindspot",
            },
            "streams": {
                STREAM: {"type": "camera", "stream_properties": {"intrinsics_pinhole": intrinsics}}
            },
            "objects": {
                "0": {
                    "name": "pedestrian",
                    "type": "Pedestrian",
                    "frame_intervals": _intervals(shown),
                }
            }
            if shown
            else {},
            "frame_intervals": _intervals(steps),
            "frames": frames,
        }
    }


def _intervals(steps: Sequence[int]) -> list[dict[str, int]]:
    """Rising step numbers as OpenLABEL's intervals, which have no gap inside."""
    starts = [step for step in steps if step - 1 not in steps]
    ends = [step for step in steps if step + 1 not in steps]
    return [
        {"frame_start": start, "frame_end": end} for start, end in zip(starts, ends, strict=True)
    ]
