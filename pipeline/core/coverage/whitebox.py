"""White-box coverage: the share of a network's behaviour that images trigger (thesis 3.4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Activations = NDArray[np.float32]
"""(images, neurons) of one layer."""
SECTIONS = 10
"""Sections of a neuron's training range."""
TOP = 2
"""Most active neurons of a layer that count."""


@dataclass(frozen=True)
class Profile:
    """The range of each neuron over the training images.

    low, high: for each layer (neurons,) the lowest and highest activation.
    """

    low: tuple[Activations, ...]
    high: tuple[Activations, ...]

    @staticmethod
    def of(layers: Sequence[Activations]) -> Profile:
        """The profile of at least one training image; layers: (images, neurons) of each layer."""
        low = tuple(layer.min(axis=0) for layer in layers)
        return Profile(low, tuple(layer.max(axis=0) for layer in layers))

    def joined(self, other: Profile) -> Profile:
        """The profile of both sets of images together."""
        low = tuple(np.minimum(a, b) for a, b in zip(self.low, other.low, strict=True))
        high = tuple(np.maximum(a, b) for a, b in zip(self.high, other.high, strict=True))
        return Profile(low, high)


@dataclass(frozen=True)
class WhiteBoxCoverage:
    """Shares in [0, 1].

    Attributes:
        neuron: neurons that were active at least once.
        multisection: sections of the neurons' training ranges that were reached, of `SECTIONS`
            each.
        strong: neurons activated at least as much as by any training image.
        top: neurons that were among the `TOP` most active of their layer at least once.
        pairs: pairs of neurons of a layer that were active together (2-way sparse).
    """

    neuron: float
    multisection: float
    strong: float
    top: float
    pairs: float


class WhiteBox:
    """Accumulates the coverage of images, shown in batches.

    A neuron that is constant over the training images has no sections and cannot be strongly
    active, but still counts as a neuron.

    Args:
        profile: of the training images.

    >>> layer = np.array([[0.0, 1.0, 0.0]], np.float32)
    >>> box = WhiteBox(Profile.of([np.array([[0, 0, 0], [1, 1, 1]], np.float32)]))
    >>> box.show([layer])
    >>> round(box.coverage().neuron, 3)
    0.333
    """

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        sizes = [len(high) for high in profile.high]
        self._active = [np.zeros(size, bool) for size in sizes]
        self._sections = [np.zeros((size, SECTIONS), bool) for size in sizes]
        self._strong = [np.zeros(size, bool) for size in sizes]
        self._top = [np.zeros(size, bool) for size in sizes]
        self._pairs = [np.zeros((size, size), bool) for size in sizes]

    def show(self, layers: Sequence[Activations]) -> None:
        """Add a batch of images; layers: (images, neurons) activations of each layer."""
        ranges = zip(layers, self._profile.low, self._profile.high, strict=True)
        for i, (values, low, high) in enumerate(ranges):
            active = values > 0
            self._active[i] |= active.any(axis=0)
            moved = high > low
            self._strong[i] |= moved & (values >= high).any(axis=0)
            highest = np.argsort(values, axis=1)[:, -TOP:]
            self._top[i][np.unique(highest[np.take_along_axis(active, highest, axis=1)])] = True
            together = active.astype(np.float32)
            self._pairs[i] |= together.T @ together > 0
            inside = (values >= low) & (values <= high) & moved
            place = (values - low) / np.where(moved, high - low, 1) * SECTIONS
            section = np.minimum(place, SECTIONS - 1).astype(int)
            image, neuron = np.nonzero(inside)
            self._sections[i][neuron, section[image, neuron]] = True

    def coverage(self) -> WhiteBoxCoverage:
        """Coverage of all images so far."""
        neurons = sum(len(active) for active in self._active)
        ranges = zip(self._profile.low, self._profile.high, strict=True)
        moved = sum(int((high > low).sum()) for low, high in ranges)
        pairs = sum(len(active) * (len(active) - 1) // 2 for active in self._active)
        met = sum(int(np.triu(layer, 1).sum()) for layer in self._pairs)
        return WhiteBoxCoverage(
            neuron=_total(self._active) / neurons,
            multisection=_total(self._sections) / max(1, SECTIONS * moved),
            strong=_total(self._strong) / max(1, moved),
            top=_total(self._top) / neurons,
            pairs=met / max(1, pairs),
        )


def _total(layers: Sequence[NDArray[np.bool_]]) -> int:
    return sum(int(layer.sum()) for layer in layers)
