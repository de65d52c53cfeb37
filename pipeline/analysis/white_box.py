"""The images and the profile for white-box coverage of a detector."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.artefacts.tables import read_frames
from pipeline.core.coverage.whitebox import Profile
from pipeline.core.space import Ints
from pipeline.detectors.yolo.activations import activations
from pipeline.detectors.yolo.network import Yolo

FRAMES, PROFILED = 250, 600
"""Largest number of images per set and of training images, drawn evenly.

Coverage grows with the number of images, so all sets have the same number."""
DRAW_SEED = 0


def profile_of(network: Yolo, images: NDArray[np.uint8]) -> Profile:
    """The range of every neuron over (n, height, width, 3) images."""
    profiles = [Profile.of(layers) for layers in activations(network, images)]
    joined = profiles[0]
    for profile in profiles[1:]:
        joined = joined.joined(profile)
    return joined


def kept_frames(paths: Sequence[Path]) -> list[bytes]:
    """The kept frames of some campaigns as JPEG bytes."""
    tables = [read_frames(path, ["test_id", "step", "image"]) for path in paths]
    images: list[bytes] = (
        pd.concat(tables, ignore_index=True).sort_values(["test_id", "step"])["image"].to_list()
    )
    return images


def drawn(many: int, count: int) -> Ints:
    """Sorted indices (count,) below `many`, drawn evenly without replacement."""
    return np.sort(np.random.default_rng(DRAW_SEED).choice(many, count, replace=False))
