"""Reasons to reject a campaign frame for training (thesis section 7.2); each has a criterion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.artefacts.dataset import decode_jpeg
from pipeline.config.sections import Filter
from pipeline.core.boxes import iou
from pipeline.core.signals import SIDES
from pipeline.core.visibility import detectability

Bools = NDArray[np.bool_]
KEPT = {"visible": "pedestrian visible", "negative": "no pedestrian in the image"}
"""Reasons to keep a frame -> meaning; empty frames teach the detector what is not a pedestrian."""
MIN_VISIBLE_SHARE = 0.1
THUMBNAIL = (40, 24)
SAME_GREY, SAME_IOU = 3.0, 0.8
"""Frames of an episode are near duplicates if their thumbnails differ by less on average and the
pedestrian's boxes overlap by more."""


@dataclass(frozen=True)
class Criterion:
    """One reason to reject frames.

    Attributes:
        reason: Its name in the filter table.
        meaning: Its text in the report.
        rejects: Takes n frames (columns of frames.parquet), a mask (n,) bool of the frames that all
            earlier criteria keep, and the section `filter`; returns (n,) bool.
    """

    reason: str
    meaning: str
    rejects: Callable[[pd.DataFrame, Bools, Filter], Bools]


def shows(frames: pd.DataFrame) -> Bools:
    """Whether each frame shows the pedestrian at all, (n,)."""
    return np.asarray(frames["visible_pixels"] > 0)


def _few_pixels(frames: pd.DataFrame, _: Bools, section: Filter) -> Bools:
    few: Bools = np.asarray(frames["visible_pixels"] < section.min_visible_pixels)
    return shows(frames) & few


def _barely_in_view(frames: pd.DataFrame, _: Bools, __: Filter) -> Bools:
    pixels, whole = frames["visible_pixels"].to_numpy(float), frames["whole_pixels"].to_numpy(float)
    barely: Bools = np.asarray(pixels / np.maximum(whole, 1) < MIN_VISIBLE_SHARE)
    return shows(frames) & barely


def _low_contrast(frames: pd.DataFrame, _: Bools, section: Filter) -> Bools:
    shown = detectability(
        frames["visible_pixels"].to_numpy(float), frames["contrast"].to_numpy(float)
    )
    return shows(frames) & (shown < section.min_detectability)


def _near_duplicate(frames: pd.DataFrame, kept: Bools, _: Filter) -> Bools:
    """The ego waits and nothing moves: the frame repeats the last kept frame of its episode.

    Frames come in order of time.
    """
    repeats = np.zeros(len(frames), bool)
    boxes = frames[[f"visible_{side}" for side in SIDES]].to_numpy(float)
    last: tuple[str, NDArray[np.float64], NDArray[np.float64]] | None = None
    for row, (test_id, image) in enumerate(zip(frames["test_id"], frames["image"], strict=True)):
        if not kept[row]:
            continue
        shown = cv2.resize(decode_jpeg(image), THUMBNAIL, interpolation=cv2.INTER_AREA).mean(axis=2)
        if last is not None and last[0] == test_id:
            shown_before, box_before = last[1:]
            same_image = np.abs(shown - shown_before).mean() < SAME_GREY
            repeats[row] = same_image and _same_box(boxes[row], box_before)
        if not repeats[row]:
            last = (test_id, shown, boxes[row])
    return repeats


def _same_box(box: NDArray[np.float64], before: NDArray[np.float64]) -> bool:
    """Whether two boxes (4,) overlap well, or neither exists (NaN)."""
    hidden, hidden_before = np.isnan(box).any(), np.isnan(before).any()
    if hidden or hidden_before:
        return bool(hidden and hidden_before)
    return bool(iou([box], [before])[0, 0] > SAME_IOU)


CRITERIA = (
    Criterion("few_pixels", "too few visible pixels", _few_pixels),
    Criterion("barely_in_view", "less than a tenth of the pedestrian in view", _barely_in_view),
    Criterion("low_contrast", "too little contrast", _low_contrast),
    Criterion("near_duplicate", "nearly the same as the frame before", _near_duplicate),
)
"""In the order of judging: the first criterion that rejects a frame gives the reason."""
MEANINGS = KEPT | {criterion.reason: criterion.meaning for criterion in CRITERIA}
"""Every reason in a filter table except a person's, with its meaning."""
