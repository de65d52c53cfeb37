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

REFINEMENT = {"iterations", "batch_size", "learning_rate", "added_share"}
"""The settings of a training that continues from the predecessor."""


def fit_version(
    config: Config, weights: Path, images: ImageSets, seed: tuple[int, ...], run: Run
) -> Fitted:
    """Train the network of a version.

    Args:
        config: of the study.
        weights: of its predecessor.
        images: to train on.
        seed: of the version, combined with the round from the second round on; training from
            scratch takes the first of them.
        run: how the training is executed.
    """
    settings = config.retraining
    if settings.start == "scratch":
        base, added = images.base, images.added
        everything = base if added is None else joined(base, added)
        # All added frames: the filter or a person has judged them.
        indices = np.concatenate([usable(base), np.arange(len(base), len(everything))])
        section = _from_scratch(config) | {"seed": seed[0]}
        return train_from_scratch(everything, indices, images.validation, section, run)
    plan = Refinement(**settings.model_dump(include=REFINEMENT), seed=seed)
    return retrain(load_weights(weights), images, plan, run)


def settings_taken(config: Config) -> dict[str, Any]:
    """The settings of a version: of its frames and of the training that it starts with."""
    settings = config.retraining
    frames = settings.model_dump(include={"start", "selection", "empty_share"})
    if settings.start == "scratch":
        return frames | _from_scratch(config)
    return frames | settings.model_dump(include=REFINEMENT)


def _from_scratch(config: Config) -> dict[str, Any]:
    """Section `training` without early stopping: compared versions take equally many steps."""
    settings = config.training
    patience = settings.crop_iterations + settings.frame_iterations
    return settings.model_dump() | {"patience": patience}
