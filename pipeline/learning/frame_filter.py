"""Judges which campaign frames are fit for training (thesis section 7.2), with the reason for each."""

from __future__ import annotations

from collections.abc import Collection
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
    """Keep or reject each frame by `CRITERIA`; rows in the given order, columns of the filter table.

    frames: columns of frames.parquet, each episode's in order of time. A frame that no criterion rejects is `visible` or, if the pedestrian
    does not show, `negative`.
    """
    kept, reasons = (
        np.ones(len(frames), bool),
        np.where(shows(frames), "visible", "negative").astype(object),
    )
    for criterion in CRITERIA:
        rejected = kept & criterion.rejects(frames, kept, section)
        reasons[rejected] = criterion.reason
        kept &= ~rejected
    return frames.assign(kept=kept, reason=reasons)[list(COLUMNS)]


def overrule(
    judged: pd.DataFrame, overrules: pd.DataFrame, elsewhere: Collection[str], path: Path
) -> pd.DataFrame:
    """Apply a person's rows; the reason then reads `overruled (was <reason>)`.

    elsewhere: names of the tests in the study's other filter tables; rows about them are ignored here. path: of `overrules`.

    InputError for a row about a frame that does not exist, and for duplicate rows.
    """
    rows = {
        frame: row for row, frame in enumerate(zip(judged["test_id"], judged["step"], strict=True))
    }
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
                f"{path}, line {line}: expected a kept frame of this study, got frame {step} of test {test_id!r}"
            )
    return judged.assign(kept=kept, reason=reasons)


def judged_elsewhere(config: Config, strategy: str, version: str) -> set[str]:
    """Names of the study's search tests, except those in the filter table of one strategy against one version."""
    others = config.searched - {(strategy, version)}
    campaigns = (
        CampaignId(scenario, *other, seed)
        for scenario in config.search
        for other in others
        for seed in config.seeds
    )
    return {str(test) for campaign in campaigns for test in campaign.tests(config.campaign.tests)}
