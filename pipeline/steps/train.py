"""Step `train`: the model version `base` (D_o), shipped or trained from scratch (thesis section 5.4)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from pipeline.artefacts.dataset import read_dataset
from pipeline.artefacts.model_card import read_card, read_curve
from pipeline.config.schema import Config
from pipeline.detectors.yolo.data import usable
from pipeline.detectors.yolo.recipe import train_from_scratch
from pipeline.detectors.yolo.training import Fitted
from pipeline.detectors.yolo.weights import load_weights
from pipeline.learning import leakage
from pipeline.learning.versions import write_version
from pipeline.progress import Progress


def run(config: Config, *, base_set: Path, out: Path, checkpoint: Path, threads: int, progress: Progress) -> None:
    """Write weights.safetensors, model.onnx, curve.csv and `out`, the version's model.json.

    base_set: truth.coco.json of the base set; its validation images give the metrics. checkpoint: file that a training which was killed
    goes on from.
    """
    torch.set_num_threads(threads)
    validation = read_dataset(base_set.parent, "val")
    if config.base.source == "shipped":
        shipped = Path(config.base.weights)
        fitted = Fitted(
            load_weights(shipped / "weights.safetensors"), tuple(read_curve(curve)) if (curve := shipped / "curve.csv").exists() else ()
        )
        card = read_card(shipped / "model.json")
        leakage.refuse_towns(config, base_set, [], shipped / "model.json")
        history: dict[str, Any] = {"data": card.data, "training": card.training, "seed": card.seed, "towns": card.towns}
    else:
        images, towns = read_dataset(base_set.parent, "train"), leakage.refuse_towns(config, base_set, [])
        settings = config.training.model_dump()
        fitted = train_from_scratch(images, usable(images), validation, settings, checkpoint=checkpoint, threads=threads, progress=progress)
        taken = {"images": len(images), **settings}
        history = {"data": {"base_set": images.digest}, "training": taken, "seed": config.training.seed, "towns": towns}
    write_version(config, fitted, validation, out, version="base", parent=None, **history)
    checkpoint.unlink(missing_ok=True)
    progress(1, 1, "evaluated")
