"""The frames closest to the filter's thresholds, kept and rejected, as crops for a person."""

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
    """One frame near the thresholds.

    Attributes:
        visible_pixels: Visible pixels of the pedestrian.
        contrast: Grey levels, 0 to 255.
        crop: (CROP, CROP, 3) uint8 RGB around the pedestrian.
        box: (4,) the pedestrian's box in the crop, pixels.
    """

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
    """The rows of a filter table nearest to the thresholds by ratio, the nearest first.

    Args:
        judged: Filter table.
        min_visible_pixels: Threshold on the visible pixels.
        min_detectability: Threshold on the detectability.
        count: Largest number of rows; half of them are kept frames.

    Returns:
        At most one row a test, of the kept and of the rejected frames each.
    """
    rows = judged[judged["reason"].isin(JUDGED)]
    pixels = np.log2(rows["visible_pixels"] / max(min_visible_pixels, 1))
    clarity = detectability(rows["visible_pixels"], rows["contrast"].clip(lower=0.01))
    clear = np.log2(clarity / max(min_detectability, 0.01))
    ranked = rows.assign(border=np.minimum(pixels, clear).abs())
    ordered = ranked.sort_values(["border", "test_id", "step"], kind="stable")
    if ordered.empty:
        return ordered
    groups = ordered.groupby("kept", sort=False)
    return pd.concat([group.drop_duplicates("test_id").head(count // 2) for _, group in groups])


def cases(rows: pd.DataFrame, frames: Sequence[Path]) -> list[Case]:
    """The crops of rows of a filter table, in the order of the rows.

    Args:
        rows: Rows of a filter table.
        frames: frames.parquet of the campaigns.
    """
    key = ["test_id", "step"]
    by_frame: dict[tuple[str, int], Case] = {}
    for path in frames:
        if read_frames(path, key).merge(rows[key], on=key).empty:
            continue
        matched = read_frames(path).merge(rows[[*key, "kept"]], on=key)
        for row in matched.to_dict("records"):
            crop, box = _crop(decode_jpeg(row["image"]), np.array([row[side] for side in VISIBLE]))
            by_frame[row["test_id"], row["step"]] = Case(
                test_id=row["test_id"],
                step=row["step"],
                kept=bool(row["kept"]),
                visible_pixels=int(row["visible_pixels"]),
                contrast=float(row["contrast"]),
                crop=crop,
                box=box,
            )
    keys = zip(rows["test_id"], rows["step"], strict=True)
    return [by_frame[frame] for frame in keys if frame in by_frame]


def _crop(
    image: NDArray[np.uint8], box: NDArray[np.float64]
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """A square around a box, at one size, and the box in it; beyond the image its edge repeats."""
    side = max(CROP, 2 * float(np.max(box[2:] - box[:2])))
    left, top = (box[:2] + box[2:]) / 2 - side / 2
    scale = CROP / side
    matrix = np.array([[scale, 0, -scale * left], [0, scale, -scale * top]])
    shown = cv2.warpAffine(
        image, matrix, (CROP, CROP), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(shown, np.uint8), (box - (left, top, left, top)) * scale
