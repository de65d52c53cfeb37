"""The recipe of the base detector: crops first, then full frames, hard images more often."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.artefacts.dataset import ImageSet
from pipeline.detectors.yolo.data import Boxes, Images, Stream, batch, hardness
from pipeline.detectors.yolo.network import SIZES, Yolo
from pipeline.detectors.yolo.training import Fitted, Lesson, Run, Schedule, fit, initial_model
from pipeline.detectors.yolo.validation import watching

CROP_SIZE = (160, 96)
CROP_PHASE, FRAME_PHASE = 0, 1
RELIT_FROM, RELIT_ALL = 30_000, 200_000
"""Images shown before colours and light change in the first and in all examples.

A short training learns more from images as they are."""
WARM_UP_SHARE = 0.035
WARM_UP = 200


def train_from_scratch(
    images: ImageSet,
    indices: NDArray[np.int64],
    validation: ImageSet,
    config: Mapping[str, Any],
    run: Run,
) -> Fitted:
    """Train a detector; a killed training resumes from the run's checkpoint.

    Args:
        images: to train on.
        indices: of the training images.
        validation: gives the curve and stops the training early if the curve no longer rises.
        config: section `training` of the config.
        run: how the training is executed.
    """
    seed, size = int(config["seed"]), int(config["batch_size"])
    iterations = int(config["crop_iterations"]), int(config["frame_iterations"])
    warm_up = min(WARM_UP, round(WARM_UP_SHARE * sum(iterations)))
    share = math.prod(CROP_SIZE) / math.prod(images.size)
    schedule = Schedule(
        *iterations, float(config["learning_rate"]), warm_up=warm_up, muon=True, crop_share=share
    )
    repeats = hardness(images, int(config["oversampling"]))[indices]
    crops, frames = (Stream(indices, repeats, (seed, phase)) for phase in (CROP_PHASE, FRAME_PHASE))

    def feed(iteration: int) -> tuple[Images, Boxes]:
        relit = relit_share(iteration * size)
        if iteration < schedule.crop_iterations:
            chosen = crops.take(iteration * size, size)
            return batch(images, chosen, CROP_SIZE, (seed, CROP_PHASE, iteration), relit)
        chosen = frames.take((iteration - schedule.crop_iterations) * size, size)
        return batch(images, chosen, images.size, (seed, FRAME_PHASE, iteration), relit)

    shown = [images.digest, indices.tolist(), validation.digest]
    content = json.dumps([dict(config), shown], sort_keys=True)
    identity = hashlib.sha256(content.encode()).hexdigest()
    watch = watching(validation, int(config["validate_every"]), int(config["patience"]))
    model = initial_model(seed, lambda: Yolo(SIZES[config["size"]]))
    return fit(model, Lesson(schedule, feed, identity, watch), run)


def relit_share(shown: int) -> float:
    """Share of examples with other colours and light, in [0, 1], after `shown` images.

    >>> relit_share(0), relit_share(115_000), relit_share(1_000_000)
    (0.0, 0.5, 1.0)
    """
    return min(1.0, max(0.0, (shown - RELIT_FROM) / (RELIT_ALL - RELIT_FROM)))
