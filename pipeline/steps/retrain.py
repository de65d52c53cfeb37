"""Step `retrain`: the versions random (D_r), adaptive (D_a) and control from the base version (thesis section 7.1)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from pipeline.artefacts.campaign import read_frames
from pipeline.artefacts.dataset import ImageSet, decode_jpeg, image_set, read_dataset
from pipeline.artefacts.files import sha256
from pipeline.artefacts.filter import read_filter
from pipeline.config import Config
from pipeline.detectors.yolo.retraining import retrain
from pipeline.detectors.yolo.weights import load_weights
from pipeline.progress import Progress
from pipeline.protocols import Box, InputError, Truth
from pipeline.steps.train import write_version


def run(
    config: Config,
    *,
    version: str,
    base_set: Path,
    parent: Path,
    filters: list[Path],
    frames: list[Path],
    out: Path,
    threads: int,
    progress: Progress,
) -> None:
    """Retrain and write weights.safetensors, model.onnx and `out`, the version's model.json.

    parent: model.json of the base version. filters: the filter tables of the random and of the adaptive strategy, in this order; both,
    because both versions get the same number of added frames. frames: frames.parquet of the version's own campaigns, none for the control.
    """
    torch.set_num_threads(threads)
    settings = config.retraining
    base = read_dataset(base_set.parent, "train")
    weights = parent.with_name("weights.safetensors")
    tables = [read_filter(path) for path in filters]
    count = min(settings.added_frames, *(int(table["kept"].sum()) for table in tables))
    if count == 0:
        raise InputError(f"{' and '.join(map(str, filters))}: a filter kept no frame at all; run more tests, or relax section `filter`")
    added = None if version == "control" else _added(tables[version == "adaptive"], frames, count, settings.seed, config.held_out)
    data = {"base_set": base.digest, "parent": sha256(weights)} | ({} if added is None else {"added": added.digest})
    identity = hashlib.sha256(json.dumps([settings.model_dump(), data]).encode()).hexdigest()
    checkpoint = out.with_name("checkpoint.pt")
    schedule = settings.model_dump(exclude={"added_frames"})
    model = retrain(
        load_weights(weights), base, added, **schedule, identity=identity, checkpoint=checkpoint, threads=threads, progress=progress
    )
    training = {**settings.model_dump(), "base_images": len(base), "added_frames": 0 if added is None else count}
    write_version(
        config,
        model,
        read_dataset(base_set.parent, "val"),
        out,
        version=version,
        parent="base",
        data=data,
        training=training,
        seed=settings.seed,
    )
    checkpoint.unlink(missing_ok=True)


def _added(judged: pd.DataFrame, paths: list[Path], count: int, seed: int, held_out: Sequence[str]) -> ImageSet:
    """`count` of the kept frames, drawn without replacement; the draw depends on the seed and on the frames alone."""
    if leaked := sorted({test for test in judged["test_id"] if test.partition("-")[0] in held_out}):
        raise InputError(f"frames of held-out scenarios must not be learnt: {', '.join(leaked[:5])}; make the filter tables again")
    kept = judged.loc[judged["kept"], ["test_id", "step"]].sort_values(["test_id", "step"], ignore_index=True)
    chosen = kept.iloc[np.sort(np.random.default_rng(seed).choice(len(kept), count, replace=False))]
    rows = pd.concat([read_frames(path).merge(chosen, on=["test_id", "step"]) for path in paths], ignore_index=True)
    if len(rows) != count:
        raise InputError(f"the filter names {count} frames, {len(rows)} of them are in {', '.join(map(str, paths))}; run filter again")
    rows = rows.sort_values(["test_id", "step"], ignore_index=True)
    digest = hashlib.sha256(b"".join(rows["image"])).hexdigest()
    return image_set([(decode_jpeg(row["image"]), _truth(row)) for _, row in rows.iterrows()], digest)


def _truth(row: pd.Series) -> Truth:
    return Truth(_box(row, "visible"), _box(row, "whole"), int(row["visible_pixels"]), int(row["whole_pixels"]), float(row["contrast"]))


def _box(row: pd.Series, kind: str) -> Box | None:
    left, top, right, bottom = (float(row[f"{kind}_{side}"]) for side in ("left", "top", "right", "bottom"))
    return None if np.isnan(left) else (left, top, right, bottom)
