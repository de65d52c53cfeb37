"""The frames of the campaigns that a version learns beside the base set."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.artefacts.dataset import ImageSet, decode_jpeg, image_set, joined
from pipeline.artefacts.filter_table import read_filter
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import frame_truth, read_frames, read_tests
from pipeline.config.schema import Config
from pipeline.core.lineage import Version
from pipeline.detectors.yolo.data import usable
from pipeline.detectors.yolo.recipe import train_from_scratch
from pipeline.detectors.yolo.retraining import retrain
from pipeline.detectors.yolo.training import Fitted
from pipeline.detectors.yolo.weights import load_weights
from pipeline.errors import InputError
from pipeline.learning import selection
from pipeline.progress import Progress


@dataclass(frozen=True)
class Source:
    """Where added frames come from: the filter tables, frames and tests of one strategy's campaigns."""

    filters: Sequence[Path]
    frames: Sequence[Path]
    tests: Sequence[Path]

    def read(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """The verdict on every frame, and every test; InputError that names a test of the filter tables that no campaign has."""
        judged = pd.concat([read_filter(path) for path in self.filters], ignore_index=True)
        tests = pd.concat([read_tests(path) for path in self.tests], ignore_index=True)
        if unknown := sorted(set(judged["test_id"]) - set(tests["test_id"])):
            names = ", ".join(map(str, self.filters))
            raise InputError(f"{names}: expected frames of the campaigns' tests, got one of test {unknown[0]!r}; run filter again")
        return judged, tests


def _taken(config: Config) -> dict[str, Any]:
    """The settings that a version was made with: of the frames, and of the training that `retraining.start` chose."""
    settings = config.retraining
    frames = settings.model_dump(include={"start", "selection", "empty_share"})
    if settings.start == "scratch":
        return frames | _from_scratch(config)
    return frames | settings.model_dump(include={"batch_size", "iterations", "learning_rate", "added_share"})


def _from_scratch(config: Config) -> dict[str, Any]:
    """Section `training` without an early end: versions that are compared take equally many steps."""
    settings = config.training
    return settings.model_dump() | {"patience": settings.crop_iterations + settings.frame_iterations}


def _fit(
    config: Config,
    weights: Path,
    base: ImageSet,
    added: ImageSet | None,
    validation: ImageSet,
    seed: tuple[int, ...],
    data: dict[str, str],
    checkpoint: Path,
    threads: int,
    progress: Progress,
) -> Fitted:
    settings = config.retraining
    if settings.start == "scratch":
        everything = base if added is None else joined(base, added)
        # All added frames: the filter has judged them, or a person has.
        indices = np.concatenate([usable(base), np.arange(len(base), len(everything))])
        section = _from_scratch(config) | {"seed": seed[0]}
        return train_from_scratch(everything, indices, validation, section, checkpoint=checkpoint, threads=threads, progress=progress)
    steps = settings.model_dump(include={"iterations", "batch_size", "learning_rate", "added_share"}) | {"seed": seed}
    identity = hashlib.sha256(json.dumps([steps, data]).encode()).hexdigest()
    model = load_weights(weights)
    return retrain(model, base, added, validation, **steps, identity=identity, checkpoint=checkpoint, threads=threads, progress=progress)


def choose(config: Config, sources: dict[str, Source], version: Version, spaces: Sequence[Path], seed: int) -> pd.DataFrame:
    """Which frames a version learns from: test_id, step and the scenario, as many as the other source could give, too.

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
        raise InputError(f"{tables}: nothing is left to learn from; run more tests, or relax `filter` or `retraining.selection`")
    chosen = selection.draw(pools[version.kind], count, settings.empty_share, seed)
    return chosen.assign(scenario=chosen["test_id"].map(scenarios))


def read_added(chosen: pd.DataFrame, paths: Sequence[Path]) -> ImageSet:
    """The images and labels of the chosen frames; InputError if one is not in the campaigns' frames.parquet."""
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
