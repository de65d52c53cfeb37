"""Step `filter`: which campaign frames are fit for training (thesis section 7.2), with the reason for each.

Adaptive strategies look for tests in which the pedestrian is hard to see, so many labels are right and yet no person could
find the pedestrian. The thesis threw such images out by eye; here measured visibility decides, and a person can overrule it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.artefacts.campaign import read_frames
from pipeline.artefacts.filter import COLUMNS, read_overrules, write_filter
from pipeline.config import Config
from pipeline.protocols import InputError

Progress = Callable[[int, int, str], None]
MIN_VISIBLE_SHARE = 0.1
NEEDED = ["test_id", "step", "visible_pixels", "whole_pixels", "contrast", "confidence"]


def run(config: Config, *, frames: Sequence[Path], out: Path, progress: Progress) -> None:
    """Judge every kept frame of one strategy's campaigns and write the table.

    frames: frames.parquet of each campaign.

    Raises InputError, naming the row, if a person's table (`filter.overrules`) overrules a frame that does not exist.
    """
    tables = []
    for done, path in enumerate(frames, 1):
        tables.append(read_frames(path, NEEDED))
        progress(done, len(frames), "/".join(path.parts[-5:-1]))
    judged = judge(pd.concat(tables, ignore_index=True), config.filter.min_visible_pixels, config.filter.min_contrast)
    if config.filter.overrules is not None:
        path = Path(config.filter.overrules)
        others = [name for name in config.strategies if not judged["test_id"].str.contains(f"-{name}-", regex=False).any()]
        judged = overrule(judged, read_overrules(path), others, path)
    write_filter(out, judged)


def judge(frames: pd.DataFrame, min_visible_pixels: int, min_contrast: float) -> pd.DataFrame:
    """Keep or reject each frame by what shows of the pedestrian; rows in the order given, columns of the filter table.

    frames: columns of frames.parquet. min_contrast: grey levels. Reasons: `negative` (kept: nobody shows, which teaches what is no
    pedestrian), `visible` (kept), `few_pixels`, `barely_in_view` (under a tenth of the pedestrian shows), `low_contrast`.
    """
    pixels, whole = frames["visible_pixels"].to_numpy(), frames["whole_pixels"].to_numpy()
    conditions = [
        pixels == 0,
        pixels < min_visible_pixels,
        pixels / np.maximum(whole, 1) < MIN_VISIBLE_SHARE,
        frames["contrast"].to_numpy() < min_contrast,
    ]
    reasons = np.select(conditions, ["negative", "few_pixels", "barely_in_view", "low_contrast"], default="visible")
    kept = np.isin(reasons, ["negative", "visible"])
    return frames.assign(kept=kept, reason=reasons)[list(COLUMNS)]


def overrule(judged: pd.DataFrame, overrules: pd.DataFrame, others: Sequence[str], path: Path) -> pd.DataFrame:
    """Let a person's rows decide; the reason then reads `overruled (was <reason>)`.

    others: strategies without a frame here; rows about their tests are theirs to check.

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
        elif not any(f"-{other}-" in test_id for other in others):
            raise InputError(f"{path}, line {line}: expected a kept frame of this study, got frame {step} of test {test_id!r}")
    return judged.assign(kept=kept, reason=reasons)
