"""Retraining a detector on its failures: low rate, large crops, mixed with the base set.

Source: thesis section 7.1.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass

import numpy as np

from pipeline.artefacts.dataset import ImageSet
from pipeline.detectors.yolo.data import Stream, batch, usable
from pipeline.detectors.yolo.network import STRIDES, Yolo
from pipeline.detectors.yolo.training import Batch, Feed, Fitted, Lesson, Run, Schedule, fit
from pipeline.detectors.yolo.validation import watching

BASE_STREAM, ADDED_STREAM = 10, 11
CROP_SHARE = 0.82
"""Of an image's sides, shown by a crop: 256x160 of 320x192.

A step takes 0.6 of the time of full frames."""
EVALUATIONS = 2
"""Number of evaluations, for the curve only.

With early stopping, versions would take different numbers of steps."""


@dataclass(frozen=True)
class ImageSets:
    """The images of a retraining.

    Attributes:
        base: the base set.
        added: frames of campaigns or new scenes; None for a control.
        validation: gives the curve.
    """

    base: ImageSet
    added: ImageSet | None
    validation: ImageSet


@dataclass(frozen=True)
class Refinement:
    """The steps of a retraining.

    Args:
        iterations: number of batches.
        batch_size: images of a batch, at least 1.
        learning_rate: its peak, in (0, 1).
        added_share: share of the added frames in a batch, in [0, 1]; if there are any, a batch has
            at least one.
        seed: of order and augmentation.

    Raises:
        ValueError: if batch_size or added_share is out of range.
    """

    iterations: int
    batch_size: int
    learning_rate: float
    added_share: float
    seed: tuple[int, ...]

    def __post_init__(self) -> None:
        if self.batch_size < 1:
            raise ValueError(f"batch_size must be at least 1, got {self.batch_size}")
        if not 0 <= self.added_share <= 1:
            raise ValueError(f"added_share must be in [0, 1], got {self.added_share}")


def retrain(model: Yolo, images: ImageSets, plan: Refinement, run: Run) -> Fitted:
    """Continue training a network.

    Without added images this is the control: the same steps on the base set alone. Short restarts
    with a high rate, on small crops or without empty frames raise false positives even without new
    data; hence the low rate, the large crops and frozen normalisation statistics. The first stage
    stays as it is: its edges and colours are general, and a third of a step's time would go into
    it.

    Args:
        model: changed in place.
        images: to train on.
        plan: the steps.
        run: how the training is executed.
    """
    steps = plan.iterations
    model.stage4.requires_grad_(False)
    schedule = Schedule(
        0, steps, plan.learning_rate, warm_up=steps // 10, averaging=0.97, frozen_statistics=True
    )
    feed = mixed_feed(images.base, images.added, plan.batch_size, plan.added_share, plan.seed)
    added = "" if images.added is None else images.added.digest
    digests = (images.base.digest, added, images.validation.digest)
    weights = b"".join(value.cpu().numpy().tobytes() for value in model.state_dict().values())
    content = json.dumps([asdict(plan), digests]).encode() + hashlib.sha256(weights).digest()
    identity = hashlib.sha256(content).hexdigest()
    watch = watching(images.validation, -(-steps // EVALUATIONS), patience=EVALUATIONS)
    return fit(model, Lesson(schedule, feed, identity, watch), run)


def crop_of(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of the crops of images, multiples of the network's largest stride.

    >>> crop_of((320, 192))
    (256, 160)
    """
    width, height = (STRIDES[-1] * max(1, round(CROP_SHARE * side / STRIDES[-1])) for side in size)
    return width, height


def mixed_feed(
    base: ImageSet,
    added: ImageSet | None,
    batch_size: int,
    added_share: float,
    seed: tuple[int, ...],
) -> Feed:
    """Batches of which a share comes from the added frames, at the end of each batch.

    Every version sees the base images in the same order.

    Args: as for `ImageSets` and `Refinement`.
    """
    crop = crop_of(base.size)
    fresh = 0 if added is None else max(1, round(batch_size * added_share))
    old = usable(base)
    order = Stream(old, np.ones(len(old), np.int64), (*seed, BASE_STREAM))
    parts = [(base, order, batch_size - fresh, BASE_STREAM)]
    if added is not None:  # All of them: the filter or a person has already judged these frames.
        ones = np.ones(len(added), np.int64)
        order = Stream(np.arange(len(added)), ones, (*seed, ADDED_STREAM))
        parts.append((added, order, fresh, ADDED_STREAM))

    def feed(iteration: int) -> Batch:
        shown, labels = [], []
        for part, stream, count, name in parts:
            indices = stream.take(iteration * count, count)
            images, boxes = batch(part, indices, crop, (*seed, name, iteration))
            shown.append(images)
            labels.append(boxes)
        return np.concatenate(shown), np.concatenate(labels)

    return feed
