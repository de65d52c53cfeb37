"""Which campaign frames are fit for training (thesis section 7.2), with the reason for each."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.artefacts.dataset import decode_jpeg
from pipeline.artefacts.filter_table import COLUMNS
from pipeline.artefacts.tables import SIDES
from pipeline.config.schema import Config
from pipeline.core.boxes import iou
from pipeline.core.identity import CampaignId
from pipeline.errors import InputError

MIN_VISIBLE_SHARE = 0.1

THUMBNAIL = (40, 24)
SAME_GREY, SAME_IOU = 3.0, 0.8
"""Two frames of an episode show the same if their thumbnails differ by less on average, and the pedestrian's boxes overlap by more."""


def judge(frames: pd.DataFrame, min_visible_pixels: int, min_detectability: float) -> pd.DataFrame:
    """Keep or reject each frame by what shows of the pedestrian; rows in the order given, columns of the filter table.

    frames: columns of frames.parquet. min_detectability: of contrast in grey levels times the square root of the visible pixels, because
    the eye finds a fainter thing if it is larger (Rose, The sensitivity performance of the human eye, 1948). Reasons: `negative` (kept:
    nobody shows, which teaches what is no pedestrian), `visible` (kept), `few_pixels`, `barely_in_view` (under a tenth of the pedestrian
    shows), `low_contrast`.
    """
    pixels, whole = frames["visible_pixels"].to_numpy(), frames["whole_pixels"].to_numpy()
    conditions = [
        pixels == 0,
        pixels < min_visible_pixels,
        pixels / np.maximum(whole, 1) < MIN_VISIBLE_SHARE,
        frames["contrast"].to_numpy() * np.sqrt(pixels) < min_detectability,
    ]
    reasons = np.select(conditions, ["negative", "few_pixels", "barely_in_view", "low_contrast"], default="visible")
    kept = np.isin(reasons, ["negative", "visible"])
    return frames.assign(kept=kept, reason=reasons)[list(COLUMNS)]


def near_duplicates(frames: pd.DataFrame, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n,) whether a kept frame shows the same as the frame of its episode that was last kept: a car that stands, a wait for a gap.

    frames: columns of frames.parquet, each episode's in the order of time.
    """
    repeats = np.zeros(len(frames), bool)
    boxes = frames[[f"visible_{side}" for side in SIDES]].to_numpy(float)
    last: tuple[str, NDArray[np.float64], NDArray[np.float64]] | None = None
    for row, (test_id, image) in enumerate(zip(frames["test_id"], frames["image"], strict=True)):
        if not kept[row]:
            continue
        shown = cv2.resize(decode_jpeg(image), THUMBNAIL, interpolation=cv2.INTER_AREA).mean(axis=2)
        if last is not None and last[0] == test_id and _same(shown, boxes[row], *last[1:]):
            repeats[row] = True
        else:
            last = (test_id, shown, boxes[row])
    return repeats


def _same(shown: NDArray[np.float64], box: NDArray[np.float64], before: NDArray[np.float64], box_before: NDArray[np.float64]) -> bool:
    if np.abs(shown - before).mean() >= SAME_GREY or np.isnan(box).any() != np.isnan(box_before).any():
        return False
    return bool(np.isnan(box).any() or iou([box], [box_before])[0, 0] > SAME_IOU)


def thin(judged: pd.DataFrame, repeats: NDArray[np.bool_]) -> pd.DataFrame:
    """Reject the frames that repeat another; reason `near_duplicate`."""
    return judged.assign(kept=judged["kept"] & ~repeats, reason=judged["reason"].where(~repeats, "near_duplicate"))


def overrule(judged: pd.DataFrame, overrules: pd.DataFrame, elsewhere: Collection[str], path: Path) -> pd.DataFrame:
    """Let a person's rows decide; the reason then reads `overruled (was <reason>)`.

    elsewhere: names of the tests that the study's other filter tables judge; rows about them are left to those. path: of `overrules`.

    InputError for a row whose frame does not exist, and for one given twice.
    """
    rows = {frame: row for row, frame in enumerate(zip(judged["test_id"], judged["step"], strict=True))}
    kept, reasons = judged["kept"].to_list(), judged["reason"].to_list()
    seen: set[tuple[str, int]] = set()
    for line, (test_id, step, keep) in enumerate(overrules.itertuples(index=False), 2):
        if (test_id, step) in seen:
            raise InputError(f"{path}, line {line}: frame {step} of test {test_id} is overruled twice")
        seen.add((test_id, step))
        if (test_id, step) in rows:
            row = rows[(test_id, step)]
            reasons[row] = f"overruled (was {judged['reason'].iloc[row]})"
            kept[row] = bool(keep)
        elif test_id not in elsewhere:
            raise InputError(f"{path}, line {line}: expected a kept frame of this study, got frame {step} of test {test_id!r}")
    return judged.assign(kept=kept, reason=reasons)


def judged_elsewhere(config: Config, strategy: str, version: str) -> set[str]:
    """Names of the study's search tests but those of one strategy against one version, which one filter table judges."""
    others = config.searched - {(strategy, version)}
    campaigns = (CampaignId(scenario, *other, seed) for scenario in config.search for other in others for seed in config.seeds)
    return {str(test) for campaign in campaigns for test in campaign.tests(config.campaign.tests)}
