"""Retraining a detector on its failures: low rate, full frames, mixed with the base set (thesis section 7.1)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pipeline.artefacts.dataset import ImageSet
from pipeline.detectors.yolo.data import Boxes, Images, Stream, batch, usable
from pipeline.detectors.yolo.network import Yolo
from pipeline.detectors.yolo.training import Fitted, Schedule, fit
from pipeline.detectors.yolo.validation import watching
from pipeline.progress import OnProgress

BASE_STREAM, ADDED_STREAM = 10, 11
LOOKS = 2
"""For the curve only: stopping early would give one version fewer steps than another."""


def retrain(
    model: Yolo,
    base: ImageSet,
    added: ImageSet | None,
    validation: ImageSet,
    *,
    iterations: int,
    batch_size: int,
    learning_rate: float,
    added_share: float,
    seed: tuple[int, ...],
    identity: str,
    checkpoint: Path,
    threads: int,
    progress: OnProgress | None = None,
) -> Fitted:
    """Continue training `model`; with `added` None this is the control: the same steps on the base set alone.

    Short restarts with a high rate, on crops or without empty frames raise false positives even without new data;
    hence the low rate, full frames alone and frozen normalisation statistics. validation: gives the curve. seed: of order and augmentation.
    """
    schedule = Schedule(0, iterations, learning_rate, warm_up=iterations // 10, averaging=0.97, frozen_statistics=True)
    feed = mixed_feed(base, added, batch_size, added_share, seed)
    watch = watching(validation, -(-iterations // LOOKS), patience=LOOKS)
    return fit(model, schedule, feed, identity=identity, checkpoint=checkpoint, validation=watch, threads=threads, progress=progress)


def mixed_feed(
    base: ImageSet, added: ImageSet | None, batch_size: int, added_share: float, seed: tuple[int, ...]
) -> Callable[[int], tuple[Images, Boxes]]:
    """Batches whose last `added_share` comes from the added frames; every version sees the base images in the same order."""
    fresh = 0 if added is None else max(1, round(batch_size * added_share))
    old = usable(base)
    parts = [(base, Stream(old, np.ones(len(old), np.int64), (*seed, BASE_STREAM)), batch_size - fresh, BASE_STREAM)]
    if added is not None:  # All of them: the filter or a person has already judged these frames.
        everything = np.arange(len(added))
        parts.append((added, Stream(everything, np.ones(len(added), np.int64), (*seed, ADDED_STREAM)), fresh, ADDED_STREAM))

    def feed(iteration: int) -> tuple[Images, Boxes]:
        made = [batch(part, stream.take(iteration * n, n), part.size, (*seed, name, iteration)) for part, stream, n, name in parts]
        return np.concatenate([images for images, _ in made]), np.concatenate([boxes for _, boxes in made])

    return feed
