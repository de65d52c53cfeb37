"""Step `front_car_train`: trains a detector of the forward vehicle on a set of snapshots.

Training begins with the shipped detector's weights.
"""

from __future__ import annotations

from pipeline.artefacts.dataset import read_dataset
from pipeline.artefacts.files import sha256
from pipeline.artefacts.model_card import read_card
from pipeline.contract import Job, Step

STEP = Step(
    "Train a detector of the forward vehicle.",
    reads=lambda folders, wildcards: {
        **folders.dataset(f"snapshots/{wildcards['version']}"),
        "weights": f"{folders.config.base.weights}/weights.safetensors",
        "card": f"{folders.config.base.weights}/model.json",
    },
    writes=lambda folders: folders.version("{version}", "detectors"),
    sections=(
        "front_car.iterations",
        "front_car.batch_size",
        "front_car.learning_rate",
        "front_car.seed",
        "detector",
    ),
    wildcards={"version": "existing|covered"},
    parallel=True,
)


def run(job: Job) -> None:
    """Write the weights, the ONNX file, the training curve and the card of the version."""
    from pipeline.detectors.yolo.retraining import ImageSets, Refinement, retrain
    from pipeline.detectors.yolo.training import Run
    from pipeline.detectors.yolo.weights import load_weights
    from pipeline.learning.versions import Origin, write_version

    settings, weights, root = job.config.front_car, job.input("weights"), job.input("truth").parent
    images, validation = (read_dataset(root, split) for split in ("train", "val"))
    data = {"snapshots": images.digest, "parent": sha256(weights)}
    training = settings.model_dump(include={"iterations", "batch_size", "learning_rate", "seed"})
    plan = Refinement(
        settings.iterations,
        settings.batch_size,
        settings.learning_rate,
        added_share=0.0,
        seed=(settings.seed,),
    )
    sets = ImageSets(images, None, validation)
    resumable = Run(job.scratch / "checkpoint.pt", job.threads, job.progress)
    fitted = retrain(load_weights(weights), sets, plan, resumable)
    training |= {"images": len(images)}
    worlds = read_card(job.input("card")).worlds
    origin = Origin(job.wildcards["version"], "base", data, training, settings.seed, worlds)
    write_version(job.config, fitted, validation, origin, job.output("card"), job.progress)
