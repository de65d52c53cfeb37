"""Step `white_box`: measures which neurons of the base detector each strategy's frames reach.

Section 3.4.2 of the thesis defines the measures.
"""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from pipeline.artefacts.dataset import decode_jpeg, read_dataset
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.results import write
from pipeline.artefacts.white_box_results import WhiteBoxMeasures, WhiteBoxSet
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.errors import InputError


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    files: dict[str, Files] = {
        "weights": folders.model("base", "weights.safetensors"),
        "card": folders.model("base", "model.json"),
        **folders.dataset("base_set"),
    }
    for strategy in folders.config.strategies:
        files[f"frames_{strategy}"] = folders.search("frames.parquet", strategy=strategy)
    return files


STEP = Step(
    "Measure which neurons each strategy's frames reach.",
    reads=_reads,
    writes=lambda folders: {"measures": f"{folders.root}/white_box.json"},
    sections=("strategies",),
    parallel=True,
)


def run(job: Job) -> None:
    """Write white_box.json; InputError if a strategy has no frames."""
    from pipeline.analysis.white_box import FRAMES, PROFILED, drawn, kept_frames, profile_of
    from pipeline.core.coverage.whitebox import WhiteBox
    from pipeline.detectors.yolo.activations import activations
    from pipeline.detectors.yolo.threads import use_threads
    from pipeline.detectors.yolo.weights import load_weights

    use_threads(job.threads)
    network = load_weights(job.input("weights"))
    kept = {
        strategy: kept_frames(job.inputs(f"frames_{strategy}"))
        for strategy in job.config.strategies
    }
    if without := [strategy for strategy, frames in kept.items() if not frames]:
        raise InputError(
            f"frames.parquet of {', '.join(without)}: expected kept frames, got none; "
            "set campaign.keep_every to 1 or more"
        )
    training, validation = (
        read_dataset(job.input("truth").parent, split).images for split in ("train", "val")
    )
    count = min(FRAMES, len(validation), *map(len, kept.values()))
    total = 2 + len(kept)
    training = training[drawn(len(training), min(PROFILED, len(training)))]
    profile = profile_of(network, training)
    job.progress(1, total, "profile of the training images")
    images = {"validation images": validation[drawn(len(validation), count)]}
    for strategy, frames in kept.items():
        images[strategy] = np.stack([decode_jpeg(frames[i]) for i in drawn(len(frames), count)])
    sets = []
    for name, batch in images.items():
        measured = WhiteBox(profile)
        for layers in activations(network, batch):
            measured.show(layers)
        sets.append(WhiteBoxSet(name=name, images=len(batch), **asdict(measured.coverage())))
        job.progress(1 + len(sets), total, name)
    neurons = sum(len(layer) for layer in profile.high)
    write(
        job.output("measures"),
        WhiteBoxMeasures(
            layers=len(profile.high),
            neurons=neurons,
            training_images=len(training),
            sets=tuple(sets),
        ),
    )
