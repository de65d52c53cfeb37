"""The campaign frames that a version is trained on besides the base set."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pipeline.artefacts.dataset import ImageSet, decode_jpeg, image_set
from pipeline.artefacts.filter_table import read_filter
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import frame_truth, read_frames, read_tests
from pipeline.config.schema import Config
from pipeline.core.lineage import Version
from pipeline.errors import InputError
from pipeline.learning import selection


@dataclass(frozen=True)
class Source:
    """The source of added frames: the filter tables and the tests of one strategy's campaigns."""

    filters: Sequence[Path]
    tests: Sequence[Path]

    def read(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """The verdict on every frame, and every test; InputError that names a test in the filter tables that no campaign has."""
        judged = pd.concat([read_filter(path) for path in self.filters], ignore_index=True)
        tests = pd.concat([read_tests(path) for path in self.tests], ignore_index=True)
        if unknown := sorted(set(judged["test_id"]) - set(tests["test_id"])):
            names = ", ".join(map(str, self.filters))
            raise InputError(f"{names}: expected frames of the campaigns' tests, got one of test {unknown[0]!r}; run filter again")
        return judged, tests


def choose(config: Config, sources: dict[str, Source], version: Version, spaces: Sequence[Path], seed: int) -> pd.DataFrame:
    """Choose the frames that a version is trained on: test_id, step and scenario, at most as many as the other source has.

    The draw depends on the seed and on the frames alone.
    """
    settings = config.retraining
    known = {info.name: (info, space) for info, space in map(read_space, spaces)}
    pools: dict[str, pd.DataFrame] = {}
    scenarios: dict[str, str] = {}
    for name, source in sources.items():
        judged, tests = source.read()
        scenarios |= dict(zip(tests["test_id"], tests["scenario"], strict=True))
        groups = selection.groups(settings.selection, tests, known, config.regions)
        pools[name] = selection.pool(judged, groups)
    count = min(settings.added_frames * version.round, *(selection.capacity(pool, settings.empty_share) for pool in pools.values()))
    if count == 0:
        tables = " and ".join(str(path) for source in sources.values() for path in source.filters)
        raise InputError(f"{tables}: no frame is left to train on; run more tests, or relax `filter` or `retraining.selection`")
    chosen = selection.draw(pools[version.kind], count, settings.empty_share, seed)
    return chosen.assign(scenario=chosen["test_id"].map(scenarios))


def read_added(chosen: pd.DataFrame, paths: Sequence[Path]) -> ImageSet:
    """The images and labels of the chosen frames; InputError if a frame is missing from the campaigns' frames.parquet."""
    keys = ["test_id", "step"]
    rows = pd.concat([read_frames(path).merge(chosen[keys], on=keys) for path in paths], ignore_index=True)
    if len(rows) != len(chosen):
        raise InputError(
            f"the filter names {len(chosen)} frames, {len(rows)} of them are in {', '.join(map(str, paths))}; run filter again"
        )
    rows = rows.sort_values(keys, ignore_index=True)
    labels = rows.drop(columns="image").to_csv(index=False).encode()
    digest = hashlib.sha256(labels + b"".join(rows["image"])).hexdigest()
    return image_set([(decode_jpeg(row["image"]), frame_truth(row)) for _, row in rows.iterrows()], digest)
