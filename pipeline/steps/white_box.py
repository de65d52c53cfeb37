"""Step `white-box`: which of the base detector's neurons each strategy's frames reach (thesis section 3.4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch

from pipeline.analysis.white_box import FRAMES, PROFILED, _drawn, _kept, _profile
from pipeline.artefacts.dataset import decode_jpeg, read_dataset
from pipeline.artefacts.results import WhiteBoxMeasures, WhiteBoxSet, write
from pipeline.config.schema import Config
from pipeline.core.coverage.whitebox import WhiteBox
from pipeline.detectors.yolo.activations import activations
from pipeline.detectors.yolo.weights import load_weights
from pipeline.errors import InputError
from pipeline.progress import Progress


def run(config: Config, *, model: Path, base_set: Path, frames: Sequence[Path], out: Path, threads: int, progress: Progress) -> None:
    """Write white_box.json. model: model.json of the base version. frames: frames.parquet of the search campaigns, of all strategies.

    Raises InputError if a strategy has no frames.
    """
    torch.set_num_threads(threads)
    network = load_weights(model.with_name("weights.safetensors"))
    kept = {strategy: _kept([path for path in frames if path.parts[-4] == strategy]) for strategy in config.strategies}
    count = min(FRAMES, *map(len, kept.values()))
    if count == 0:
        raise InputError("white-box coverage needs frames of every strategy; run the campaigns with campaign.keep_every above 0")
    training, validation = (read_dataset(base_set.parent, split).images for split in ("train", "val"))
    total = 2 + len(kept)
    training = training[_drawn(len(training), min(PROFILED, len(training)))]
    profile = _profile(network, training)
    progress(1, total, "profile of the training images")
    images = {"validation images": validation[_drawn(len(validation), min(count, len(validation)))]}
    images |= {strategy: np.stack([decode_jpeg(every[i]) for i in _drawn(len(every), count)]) for strategy, every in kept.items()}
    sets = []
    for name, batch in images.items():
        measured = WhiteBox(profile)
        for layers in activations(network, batch):
            measured.show(layers)
        sets.append(WhiteBoxSet(name=name, images=len(batch), **asdict(measured.coverage())))
        progress(1 + len(sets), total, name)
    neurons = sum(len(layer) for layer in profile.high)
    write(out, WhiteBoxMeasures(layers=len(profile.high), neurons=neurons, training_images=len(training), sets=tuple(sets)))
