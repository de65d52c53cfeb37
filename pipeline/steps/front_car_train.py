"""Step `front-car-train`: a detector of the forward vehicle, from the shipped detector's weights and a set of snapshots."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import torch

from pipeline.artefacts.dataset import read_dataset
from pipeline.artefacts.files import sha256
from pipeline.artefacts.model_card import read_card
from pipeline.config.schema import Config
from pipeline.detectors.yolo.retraining import retrain
from pipeline.detectors.yolo.weights import load_weights
from pipeline.learning.versions import write_version
from pipeline.progress import Progress


def run(config: Config, *, version: str, snapshots: Path, out: Path, threads: int, progress: Progress) -> None:
    """Write weights.safetensors, model.onnx and `out`, the version's model.json. snapshots: truth.coco.json of its set."""
    torch.set_num_threads(threads)
    settings, weights = config.front_car, Path(config.base.weights) / "weights.safetensors"
    images = read_dataset(snapshots.parent, "train")
    data = {"snapshots": images.digest, "parent": sha256(weights)}
    training = settings.model_dump(include={"iterations", "batch_size", "learning_rate", "seed"})
    checkpoint = out.with_name("checkpoint.pt")
    validation = read_dataset(snapshots.parent, "val")
    fitted = retrain(
        load_weights(weights),
        images,
        None,
        validation,
        **training | {"seed": (settings.seed,)},
        added_share=0.0,
        identity=hashlib.sha256(json.dumps([training, data]).encode()).hexdigest(),
        checkpoint=checkpoint,
        threads=threads,
        progress=progress,
    )
    write_version(
        config,
        fitted,
        validation,
        out,
        version=version,
        parent="base",
        data=data,
        training=training | {"images": len(images)},
        seed=settings.seed,
        towns=read_card(weights.with_name("model.json")).towns,
    )
    checkpoint.unlink(missing_ok=True)
