"""The images that a version is trained on besides the base set.

They are frames of campaigns, or new random scenes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import pandas as pd

from pipeline.artefacts.dataset import ImageSet, decode_jpeg, image_set, read_dataset
from pipeline.artefacts.filter_table import read_filter
from pipeline.artefacts.scenario_space import read_spaces
from pipeline.artefacts.tables import frame_truth, read_all_tests, read_frames
from pipeline.config.schema import Config
from pipeline.core.lineage import Version
from pipeline.core.visibility import detectability
from pipeline.errors import InputError
from pipeline.learning import selection

FRAME = ["test_id", "step"]


class Source(Protocol):
    """Where added frames come from."""

    def pool(self) -> pd.DataFrame:
        """The frames that may be drawn: columns of `selection.POOL`."""

    def read(self, chosen: pd.DataFrame) -> ImageSet:
        """The images and labels of drawn rows of the pool."""


@dataclass(frozen=True)
class Campaigns:
    """Frames of a strategy's campaigns.

    Attributes:
        config: of the study.
        filters, tests, frames: files of these campaigns.
        spaces: files of the searched scenarios.
    """

    config: Config
    filters: Sequence[Path]
    tests: Sequence[Path]
    spaces: Sequence[Path]
    frames: Sequence[Path] = ()

    def pool(self) -> pd.DataFrame:
        """The frames that the filter keeps, of the tests that `retraining.selection` takes.

        A filter table also lists frames of other campaigns.
        """
        judged = pd.concat([read_filter(path) for path in self.filters], ignore_index=True)
        tests = read_all_tests(self.tests)
        taken = self.config.retraining.selection
        groups = selection.groups(taken, tests, read_spaces(self.spaces), self.config.regions)
        scenarios = dict(zip(tests["test_id"], tests["scenario"], strict=True))
        judged = judged[judged["test_id"].isin(list(scenarios))]
        return selection.pool(judged, groups, scenarios, taken)

    def read(self, chosen: pd.DataFrame) -> ImageSet:
        """The images and labels of drawn rows of the pool.

        Raises:
            InputError: if a frame is missing from the campaigns' frames.parquet.
        """
        tables = [read_frames(path).merge(chosen[FRAME], on=FRAME) for path in self.frames]
        rows = pd.concat(tables, ignore_index=True)
        if len(rows) != len(chosen):
            files = ", ".join(map(str, self.frames))
            raise InputError(
                f"the filter lists {len(chosen)} frames, only {len(rows)} are in {files};"
                " run filter again"
            )
        rows = rows.sort_values(FRAME, ignore_index=True)
        labels = rows.drop(columns="image").to_csv(index=False).encode()
        digest = hashlib.sha256(labels + b"".join(rows["image"])).hexdigest()
        labelled = [(decode_jpeg(row["image"]), frame_truth(row)) for _, row in rows.iterrows()]
        return image_set(labelled, digest)


@dataclass(frozen=True)
class Scenes:
    """Images of a set of random scenes; truth: its truth.coco.json."""

    config: Config
    truth: Path

    def pool(self) -> pd.DataFrame:
        """The images without a pedestrian, or with one as visible as the filter demands."""
        images, section = read_dataset(self.truth.parent, "train"), self.config.filter
        pixels, place = images.visible_pixels, np.arange(len(images))
        clear = detectability(pixels, images.contrast) >= section.min_detectability
        clear &= pixels >= section.min_visible_pixels
        rows = pd.DataFrame(
            {
                "test_id": "",
                "step": place,
                "empty": pixels == 0,
                "group": selection.ANY,
                "scenario": "",
                "weight": 1.0,
            }
        )
        return rows[rows["empty"] | clear].reset_index(drop=True)

    def read(self, chosen: pd.DataFrame) -> ImageSet:
        images, places = read_dataset(self.truth.parent, "train"), chosen["step"].to_numpy(np.int64)
        digest = hashlib.sha256(f"{images.digest} {places.tolist()}".encode()).hexdigest()
        return images.take(places, digest)


def choose(
    config: Config, sources: Mapping[str, Source], version: Version, seed: int
) -> pd.DataFrame:
    """Draw the frames that a version learns from.

    The draw depends on the seed and on the pools alone.

    Args:
        config: of the study.
        sources: of every arm that adds frames.
        version: which learns.
        seed: of the draw.

    Returns:
        Rows of the arm's pool, at most as many as the pool of every other arm has.

    Raises:
        InputError: if the pool of an arm has too few frames.
    """
    settings = config.retraining
    pools = {name: source.pool() for name, source in sources.items()}
    count, lacking = settings.added_frames * version.round, []
    for arm, pool in pools.items():
        capacity = selection.capacity(pool, settings.empty_share)
        count = min(count, capacity)
        if capacity == 0:
            empty = int(pool["empty"].sum())
            lacking.append(f"{arm} on ({len(pool) - empty} with a pedestrian, {empty} without)")
    if count == 0:
        raise InputError(
            f"arms: too few frames to train {', '.join(lacking)}, and `retraining.empty_share`"
            " needs both kinds; run more tests, or relax `filter` or `retraining.selection`"
        )
    return selection.draw(pools[version.arm], count, settings.empty_share, seed)
