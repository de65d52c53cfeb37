"""The frames closest to the filter's thresholds, kept and rejected, as crops that a person can judge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.artefacts.dataset import decode_jpeg
from pipeline.artefacts.tables import read_frames
from pipeline.core.signals import SIDES
from pipeline.core.visibility import detectability

JUDGED = ("visible", "few_pixels", "low_contrast")
"""Reasons that the two thresholds decide."""
CROP = 72
VISIBLE = [f"visible_{side}" for side in SIDES]
"""Columns of the box around the visible part of the pedestrian."""


@dataclass(frozen=True)
class Case:
    """One frame at the border. crop: (CROP, CROP, 3) uint8 RGB around the pedestrian; box: (4,) its box in the crop, pixels."""

    test_id: str
    step: int
    kept: bool
    visible_pixels: int
    contrast: float
    crop: NDArray[np.uint8]
    box: NDArray[np.float64]


def nearest(
    judged: pd.DataFrame, min_visible_pixels: int, min_detectability: float, count: int
) -> pd.DataFrame:
    """Up to `count` rows of a filter table, half of them kept, nearest to the thresholds by ratio; one a test, the nearest first."""
    rows = judged[judged["reason"].isin(JUDGED)]
    pixels = np.log2(rows["visible_pixels"] / max(min_visible_pixels, 1))
    clear = np.log2(
        detectability(rows["visible_pixels"], rows["contrast"].clip(lower=0.01))
        / max(min_detectability, 0.01)
    )
    ordered = rows.assign(border=np.minimum(pixels, clear).abs()).sort_values(
        ["border", "test_id", "step"], kind="stable"
    )
    if ordered.empty:
        return ordered
    return pd.concat(
        [
            group.drop_duplicates("test_id").head(count // 2)
            for _, group in ordered.groupby("kept", sort=False)
        ]
    )


def cases(rows: pd.DataFrame, frames: Sequence[Path]) -> list[Case]:
    """The crops of rows of a filter table, in their order. frames: frames.parquet of the campaigns."""
    found: dict[tuple[str, int], Case] = {}
    for path in frames:
        wanted = read_frames(path, ["test_id", "step"]).merge(
            rows[["test_id", "step"]], on=["test_id", "step"]
        )
        if not len(wanted):
            continue
        for row in (
            read_frames(path)
            .merge(rows[["test_id", "step", "kept"]], on=["test_id", "step"])
            .to_dict("records")
        ):
            crop, box = _crop(decode_jpeg(row["image"]), np.array([row[side] for side in VISIBLE]))
            shown = int(row["visible_pixels"]), float(row["contrast"])
            found[row["test_id"], row["step"]] = Case(
                row["test_id"], row["step"], bool(row["kept"]), *shown, crop, box
            )
    keys = zip(rows["test_id"], rows["step"], strict=True)
    return [found[key] for key in keys if key in found]


def _crop(
    image: NDArray[np.uint8], box: NDArray[np.float64]
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """A square around a box, twice as large as a large one, at one size; the image's edge is repeated beyond it."""
    side = max(CROP, 2 * float(np.max(box[2:] - box[:2])))
    left, top = (box[:2] + box[2:]) / 2 - side / 2
    scale = CROP / side
    matrix = np.array([[scale, 0, -scale * left], [0, scale, -scale * top]])
    shown = cv2.warpAffine(
        image, matrix, (CROP, CROP), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(shown, np.uint8), (box - (left, top, left, top)) * scale
