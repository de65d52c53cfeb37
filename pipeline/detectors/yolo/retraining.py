"""Retraining a detector on its failures: low rate, large crops, mixed with the base set (thesis section 7.1)."""

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
"""Of an image's sides, shown by a crop: 256x160 of 320x192. A step takes 0.6 of the time of full frames."""
EVALUATIONS = 2
"""Number of evaluations, for the curve only: with early stopping, versions would take different numbers of steps."""


@dataclass(frozen=True)
class ImageSets:
    """The images of a retraining. added: None for a control. validation: gives the curve."""

    base: ImageSet
    added: ImageSet | None
    validation: ImageSet

    @property
    def digests(self) -> tuple[str, ...]:
        return tuple(
            "" if images is None else images.digest
            for images in (self.base, self.added, self.validation)
        )


@dataclass(frozen=True)
class Refinement:
    """The steps of a retraining.

    learning_rate: its peak, in (0, 1). added_share: of the added frames in a batch, in [0, 1]; if there are any, a batch has at
    least one. seed: of order and augmentation.
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
    """Continue training `model`; without added images this is the control: the same steps on the base set alone.

    Short restarts with a high rate, on small crops or without empty frames raise false positives even without new data; hence the low
    rate, the large crops and frozen normalisation statistics. The first stage stays as it is: its edges and colours are general, and a
    third of a step's time would go into it.
    """
    steps = plan.iterations
    model.stage4.requires_grad_(False)
    schedule = Schedule(
        0, steps, plan.learning_rate, warm_up=steps // 10, averaging=0.97, frozen_statistics=True
    )
    feed = mixed_feed(images.base, images.added, plan.batch_size, plan.added_share, plan.seed)
    identity = hashlib.sha256(
        json.dumps([asdict(plan), images.digests]).encode() + _weights(model)
    ).hexdigest()
    return fit(
        model,
        Lesson(
            schedule,
            feed,
            identity,
            watching(images.validation, -(-steps // EVALUATIONS), patience=EVALUATIONS),
        ),
        run,
    )


def _weights(model: Yolo) -> bytes:
    """Digest of the weights that training continues from."""
    return hashlib.sha256(
        b"".join(value.cpu().numpy().tobytes() for value in model.state_dict().values())
    ).digest()


def crop_of(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of the crops of images of a size, multiples of the network's largest stride."""
    width, height = (STRIDES[-1] * max(1, round(CROP_SHARE * side / STRIDES[-1])) for side in size)
    return width, height


def mixed_feed(
    base: ImageSet,
    added: ImageSet | None,
    batch_size: int,
    added_share: float,
    seed: tuple[int, ...],
) -> Feed:
    """Batches with the last `added_share` from the added frames; every version sees the base images in the same order."""
    crop = crop_of(base.size)
    fresh = 0 if added is None else max(1, round(batch_size * added_share))
    old = usable(base)
    parts = [
        (
            base,
            Stream(old, np.ones(len(old), np.int64), (*seed, BASE_STREAM)),
            batch_size - fresh,
            BASE_STREAM,
        )
    ]
    if added is not None:  # All of them: the filter or a person has already judged these frames.
        everything = np.arange(len(added))
        parts.append(
            (
                added,
                Stream(everything, np.ones(len(added), np.int64), (*seed, ADDED_STREAM)),
                fresh,
                ADDED_STREAM,
            )
        )

    def feed(iteration: int) -> Batch:
        made = [
            batch(part, stream.take(iteration * n, n), crop, (*seed, name, iteration))
            for part, stream, n, name in parts
        ]
        return np.concatenate([images for images, _ in made]), np.concatenate(
            [boxes for _, boxes in made]
        )

    return feed
