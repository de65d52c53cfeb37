"""Which campaign frames are fit for training (thesis section 7.2), with the reason for each."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.analysis.frame_criteria import CRITERIA, shows
from pipeline.artefacts.filter_table import COLUMNS
from pipeline.config.schema import Filter
from pipeline.core.lineage import campaign_of
from pipeline.errors import InputError


def judge(frames: pd.DataFrame, section: Filter) -> pd.DataFrame:
    """Keep or reject each frame by `CRITERIA`; rows in the order given, columns of the filter table.

    frames: columns of frames.parquet, each episode's in the order of time. A frame that no criterion rejects is `visible` or, if the
    pedestrian does not show, `negative`.
    """
    kept, reasons = np.ones(len(frames), bool), np.where(shows(frames), "visible", "negative").astype(object)
    for criterion in CRITERIA:
        rejected = kept & criterion.rejects(frames, kept, section)
        reasons[rejected] = criterion.reason
        kept &= ~rejected
    return frames.assign(kept=kept, reason=reasons)[list(COLUMNS)]


def overrule(
    judged: pd.DataFrame, overrules: pd.DataFrame, scenarios: Sequence[str], searched: Collection[tuple[str, str]], path: Path
) -> pd.DataFrame:
    """Let a person's rows decide; the reason then reads `overruled (was <reason>)`.

    scenarios, searched: of the search, strategy and version. Rows about another strategy or version are for the table of that one.

    InputError for a row whose frame does not exist, and for one given twice.
    """
    rows = {frame: row for row, frame in enumerate(zip(judged["test_id"], judged["step"], strict=True))}
    here = {campaign_of(test_id)[1:] for test_id in judged["test_id"].unique()}
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
            continue
        scenario, *campaign = campaign_of(test_id)
        if tuple(campaign) in here or scenario not in scenarios or tuple(campaign) not in searched:
            raise InputError(f"{path}, line {line}: expected a kept frame of this study, got frame {step} of test {test_id!r}")
    return judged.assign(kept=kept, reason=reasons)
