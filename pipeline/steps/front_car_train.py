"""Step `front_car_train`: a detector of the forward vehicle, from the shipped detector's weights and a set of snapshots."""

from __future__ import annotations

import hashlib
import json

from pipeline.artefacts.dataset import read_dataset
from pipeline.artefacts.files import sha256
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.model_card import read_card
from pipeline.contract import Files, Job, Step, Wildcards


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    shipped = folders.config.base.weights
    return {
        **folders.dataset(f"snapshots/{wildcards['version']}"),
        "weights": f"{shipped}/weights.safetensors",
        "card": f"{shipped}/model.json",
    }


STEP = Step(
    "Train a detector of the forward vehicle.",
    reads=_reads,
    writes=lambda folders: folders.version("{version}", "detectors"),
    sections=("front_car.iterations", "front_car.batch_size", "front_car.learning_rate", "front_car.seed", "detector"),
    wildcards={"version": "existing|covered"},
    parallel=True,
)


def run(job: Job) -> None:
    """Write the weights, the ONNX file, the training's curve and the card of the version."""
    import torch

    from pipeline.detectors.yolo.retraining import retrain
    from pipeline.detectors.yolo.weights import load_weights
    from pipeline.learning.versions import write_version

    torch.set_num_threads(job.threads)
    settings, weights, root = job.config.front_car, job.input("weights"), job.input("truth").parent
    images, validation = (read_dataset(root, split) for split in ("train", "val"))
    data = {"snapshots": images.digest, "parent": sha256(weights)}
    training = settings.model_dump(include={"iterations", "batch_size", "learning_rate", "seed"})
    checkpoint = job.scratch / "checkpoint.pt"
    fitted = retrain(
        load_weights(weights),
        images,
        None,
        validation,
        **training | {"seed": (settings.seed,)},
        added_share=0.0,
        identity=hashlib.sha256(json.dumps([training, data]).encode()).hexdigest(),
        checkpoint=checkpoint,
        threads=job.threads,
        progress=job.progress,
    )
    write_version(
        job.config,
        fitted,
        validation,
        job.output("card"),
        version=job.wildcards["version"],
        parent="base",
        data=data,
        training=training | {"images": len(images)},
        seed=settings.seed,
        towns=read_card(job.input("card")).towns,
    )
    checkpoint.unlink(missing_ok=True)
