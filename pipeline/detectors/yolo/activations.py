"""Activations of the network's neurons on images.

A neuron is a channel of a convolution unit; its activation is the mean of its map. The mean is the
convention for convolutions: nearly every channel is active somewhere in every image.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.detectors.yolo.network import ConvUnit, Yolo

BATCH = 16


def activations(model: Yolo, images: NDArray[np.uint8]) -> Iterator[list[NDArray[np.float32]]]:
    """Run images in batches.

    Args:
        model: put into evaluation mode.
        images: (n, h, w, 3) uint8 RGB.

    Yields:
        For each batch an (images, channels) array per unit, in order of use.
    """
    seen: list[NDArray[np.float32]] = []

    def look(_module: Any, _inputs: Any, output: Tensor) -> None:
        seen.append(output.mean(dim=(2, 3)).numpy())

    model.eval()
    hooks = [
        module.register_forward_hook(look)
        for module in model.modules()
        if isinstance(module, ConvUnit)
    ]
    try:
        with torch.no_grad():
            for first in range(0, len(images), BATCH):
                seen.clear()
                shown = torch.from_numpy(np.ascontiguousarray(images[first : first + BATCH]))
                batch = shown.permute(0, 3, 1, 2).float().div_(255)
                model(batch.contiguous(memory_format=torch.channels_last))
                yield list(seen)
    finally:
        for hook in hooks:
            hook.remove()
