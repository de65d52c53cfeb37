"""Step `white-box`: which of the base detector's neurons each strategy's frames reach (thesis section 3.4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from pipeline.artefacts.campaign import read_frames
from pipeline.artefacts.dataset import decode_jpeg, read_dataset
from pipeline.artefacts.results import WhiteBoxMeasures, WhiteBoxSet, write
from pipeline.config import Config
from pipeline.core.coverage.whitebox import Profile, WhiteBox
from pipeline.core.space import Ints
from pipeline.detectors.yolo.activations import activations
from pipeline.detectors.yolo.model import Yolo
from pipeline.detectors.yolo.weights import load_weights
from pipeline.progress import Progress
from pipeline.protocols import InputError

FRAMES, PROFILED = 250, 600
"""Of each set, and of the training images, at most, drawn evenly: coverage grows with the number of images, so all sets have the same."""
DRAW_SEED = 0


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


def _profile(network: Yolo, images: NDArray[np.uint8]) -> Profile:
    profiles = [Profile.of(layers) for layers in activations(network, images)]
    joined = profiles[0]
    for profile in profiles[1:]:
        joined = joined.joined(profile)
    return joined


def _kept(paths: Sequence[Path]) -> list[bytes]:
    """The kept frames of some campaigns as JPEG bytes."""
    tables = [read_frames(path, ["test_id", "step", "image"]) for path in paths]
    images: list[bytes] = pd.concat(tables, ignore_index=True).sort_values(["test_id", "step"])["image"].to_list()
    return images


def _drawn(many: int, count: int) -> Ints:
    return np.sort(np.random.default_rng(DRAW_SEED).choice(many, count, replace=False))
