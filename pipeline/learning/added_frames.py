"""The frames of the campaigns that a version learns beside the base set."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.artefacts.dataset import ImageSet, decode_jpeg, image_set
from pipeline.artefacts.filter_table import read_filter
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import read_frames, read_tests
from pipeline.config.schema import Config
from pipeline.core.boxes import Box
from pipeline.core.lineage import Version
from pipeline.core.truth import Truth
from pipeline.errors import InputError
from pipeline.learning import selection


@dataclass(frozen=True)
class Source:
    """Where added frames come from: the filter tables, frames and tests of one strategy's campaigns."""

    filters: Sequence[Path]
    frames: Sequence[Path]
    tests: Sequence[Path]

    def read(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """The verdict on every frame, and every test."""
        judged = pd.concat([read_filter(path) for path in self.filters], ignore_index=True)
        return judged, pd.concat([read_tests(path) for path in self.tests], ignore_index=True)


def choose(config: Config, sources: dict[str, Source], version: Version, spaces: Sequence[Path], seed: int) -> pd.DataFrame:
    """Which frames a version learns from, `test_id` and `step`: as many as the other source could give, too.

    The draw depends on the seed and on the frames alone.
    """
    settings = config.retraining
    known = {info.name: (info, space) for info, space in map(read_space, spaces)}
    pools = {}
    for name, source in sources.items():
        judged, tests = source.read()
        groups = selection.groups(settings.selection, tests, known, config.regions)
        pools[name] = selection.pool(judged, groups)
    count = min(settings.added_frames * version.round, *(selection.capacity(pool, settings.empty_share) for pool in pools.values()))
    if count == 0:
        tables = " and ".join(str(path) for source in sources.values() for path in source.filters)
        raise InputError(f"{tables}: nothing is left to learn from; run more tests, or relax `filter` or `retraining.selection`")
    return selection.draw(pools[version.kind], count, settings.empty_share, seed)


def read_added(chosen: pd.DataFrame, paths: Sequence[Path]) -> ImageSet:
    """The images and labels of the chosen frames; InputError if one is not in the campaigns' frames.parquet."""
    rows = pd.concat([read_frames(path).merge(chosen, on=["test_id", "step"]) for path in paths], ignore_index=True)
    if len(rows) != len(chosen):
        raise InputError(
            f"the filter names {len(chosen)} frames, {len(rows)} of them are in {', '.join(map(str, paths))}; run filter again"
        )
    rows = rows.sort_values(["test_id", "step"], ignore_index=True)
    labels = rows.drop(columns="image").to_csv(index=False).encode()
    digest = hashlib.sha256(labels + b"".join(rows["image"])).hexdigest()
    return image_set([(decode_jpeg(row["image"]), _truth(row)) for _, row in rows.iterrows()], digest)


def _truth(row: pd.Series) -> Truth:
    return Truth(_box(row, "visible"), _box(row, "whole"), int(row["visible_pixels"]), int(row["whole_pixels"]), float(row["contrast"]))


def _box(row: pd.Series, kind: str) -> Box | None:
    left, top, right, bottom = (float(row[f"{kind}_{side}"]) for side in ("left", "top", "right", "bottom"))
    return None if np.isnan(left) else (left, top, right, bottom)
