"""Trains a version by section `retraining`: continued from its predecessor, or from scratch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.artefacts.dataset import joined
from pipeline.config.schema import Config
from pipeline.detectors.yolo.data import usable
from pipeline.detectors.yolo.recipe import train_from_scratch
from pipeline.detectors.yolo.retraining import ImageSets, Refinement, retrain
from pipeline.detectors.yolo.training import Fitted, Run
from pipeline.detectors.yolo.weights import load_weights


def fit_version(
    config: Config, weights: Path, images: ImageSets, seed: tuple[int, ...], run: Run
) -> Fitted:
    """The trained network of a version. weights: its predecessor's. seed: the version's, combined with the round from the second round on;
    training from scratch takes the first of them."""
    settings = config.retraining
    if settings.start == "scratch":
        base, added = images.base, images.added
        everything = base if added is None else joined(base, added)
        # All added frames: the filter or a person has judged them.
        indices = np.concatenate([usable(base), np.arange(len(base), len(everything))])
        return train_from_scratch(
            everything, indices, images.validation, _from_scratch(config) | {"seed": seed[0]}, run
        )
    plan = Refinement(
        **settings.model_dump(include={"iterations", "batch_size", "learning_rate", "added_share"}),
        seed=seed,
    )
    return retrain(load_weights(weights), images, plan, run)


def settings_taken(config: Config) -> dict[str, Any]:
    """The settings that make a version: those of the frames, and those of the training that `retraining.start` selects."""
    settings = config.retraining
    frames = settings.model_dump(include={"start", "selection", "empty_share"})
    if settings.start == "scratch":
        return frames | _from_scratch(config)
    return frames | settings.model_dump(
        include={"batch_size", "iterations", "learning_rate", "added_share"}
    )


def _from_scratch(config: Config) -> dict[str, Any]:
    """Section `training` without early stopping: versions under comparison take equally many steps."""
    settings = config.training
    return settings.model_dump() | {
        "patience": settings.crop_iterations + settings.frame_iterations
    }
