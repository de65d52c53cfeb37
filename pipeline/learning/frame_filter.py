"""Judges which campaign frames are fit for training, with reasons (thesis section 7.2)."""

from __future__ import annotations

from collections.abc import Collection
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.analysis.frame_criteria import CRITERIA, shows
from pipeline.artefacts.filter_table import COLUMNS
from pipeline.config.schema import Config
from pipeline.config.sections import Filter
from pipeline.core.identity import CampaignId
from pipeline.errors import InputError


def judge(frames: pd.DataFrame, section: Filter) -> pd.DataFrame:
    """Keep or reject each frame by `CRITERIA`.

    A frame that no criterion rejects is `visible` or, if the pedestrian does not show, `negative`.

    Args:
        frames: columns of frames.parquet, each episode's in order of time.
        section: limits of the criteria.

    Returns:
        Rows in the given order, columns of the filter table.
    """
    kept = np.ones(len(frames), bool)
    reasons = np.where(shows(frames), "visible", "negative").astype(object)
    for criterion in CRITERIA:
        rejected = kept & criterion.rejects(frames, kept, section)
        reasons[rejected] = criterion.reason
        kept &= ~rejected
    return frames.assign(kept=kept, reason=reasons)[list(COLUMNS)]


def overrule(
    judged: pd.DataFrame, overrules: pd.DataFrame, elsewhere: Collection[str], path: Path
) -> pd.DataFrame:
    """Apply a person's rows; the reason then reads `overruled (was <reason>)`.

    Args:
        judged: the filter table.
        overrules: the person's rows: test_id, step and whether to keep the frame.
        elsewhere: names of the tests in the study's other filter tables; rows about them are
            ignored here.
        path: of `overrules`, for messages.

    Raises:
        InputError: for a row about a frame that does not exist, and for duplicate rows.
    """
    frames = zip(judged["test_id"], judged["step"], strict=True)
    rows = {frame: row for row, frame in enumerate(frames)}
    kept, reasons = judged["kept"].to_list(), judged["reason"].to_list()
    seen: set[tuple[str, int]] = set()
    for line, (test_id, step, keep) in enumerate(overrules.itertuples(index=False), 2):
        if (test_id, step) in seen:
            raise InputError(
                f"{path}, line {line}: frame {step} of test {test_id} is overruled twice"
            )
        seen.add((test_id, step))
        if (test_id, step) in rows:
            row = rows[(test_id, step)]
            reasons[row] = f"overruled (was {judged['reason'].iloc[row]})"
            kept[row] = bool(keep)
        elif test_id not in elsewhere:
            raise InputError(
                f"{path}, line {line}: expected a kept frame of this study,"
                f" got frame {step} of test {test_id!r}"
            )
    return judged.assign(kept=kept, reason=reasons)


def judged_elsewhere(config: Config, strategy: str, version: str) -> set[str]:
    """Names of the study's search tests, except those of a strategy against a version."""
    others = config.searched - {(strategy, version)}
    names = set()
    for scenario, other, seed in product(config.search, others, config.seeds):
        campaign = CampaignId(scenario, *other, seed)
        names |= set(map(str, campaign.tests(config.campaign.tests)))
    return names
