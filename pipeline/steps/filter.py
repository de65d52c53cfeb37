"""Step `filter`: which campaign frames are fit for training (thesis section 7.2), with the reason for each.

Adaptive strategies look for tests in which the pedestrian is hard to see, so many labels are right and yet no person could
find the pedestrian. The thesis threw such images out by eye; here measured visibility decides, and a person can overrule it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.artefacts.filter_table import read_overrules, write_filter
from pipeline.artefacts.tables import read_frames
from pipeline.config.schema import Config
from pipeline.learning.frame_filter import (
    judge,
    near_duplicates,
    overrule,
    thin,
)
from pipeline.progress import OnProgress


def run(config: Config, *, frames: Sequence[Path], out: Path, progress: OnProgress) -> None:
    """Judge every kept frame of one strategy's campaigns and write the table.

    frames: frames.parquet of each campaign, all against one version.

    Raises InputError, naming the row, if a person's table (`filter.overrules`) overrules a frame that does not exist.
    """
    tables = []
    for done, path in enumerate(frames, 1):
        rows = read_frames(path)
        judged = judge(rows, config.filter.min_visible_pixels, config.filter.min_detectability)
        tables.append(thin(judged, near_duplicates(rows, judged["kept"].to_numpy(bool))))
        progress(done, len(frames), "/".join(path.parts[-5:-1]))
    table = pd.concat(tables, ignore_index=True)
    if config.filter.overrules is not None:
        path = Path(config.filter.overrules)
        table = overrule(table, read_overrules(path), config.search, config.searched, path)
    write_filter(out, table)
