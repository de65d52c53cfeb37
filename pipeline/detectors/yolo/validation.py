"""Metrics of a network in training, for its curve and early stopping."""

from __future__ import annotations

import numpy as np
import torch

from pipeline.artefacts.dataset import ImageSet
from pipeline.core.detections import Detections
from pipeline.detectors.evaluation import evaluate
from pipeline.detectors.suppression import IOU, reported
from pipeline.detectors.yolo.network import Yolo, cells, decode
from pipeline.detectors.yolo.training import Validation

EVALUATED = 500
"""Number of validation images, spread over the set."""
BATCH = 50
LOWEST_SCORE = 0.005


def watching(images: ImageSet, every: int, patience: int) -> Validation:
    """AP50 of visible pedestrians on up to `EVALUATED` validation images, at intervals.

    Args:
        images: validation images.
        every, patience: as for `Validation`.
    """
    places = np.linspace(0, len(images) - 1, min(EVALUATED, len(images)))
    chosen = images.take(places.astype(np.int64))
    return Validation(
        lambda model: evaluate(detected(model, chosen), chosen, threshold=0.5)["ap50"],
        every,
        patience,
    )


@torch.inference_mode()
def detected(model: Yolo, images: ImageSet) -> list[Detections]:
    """Detections in each image, with scores from `LOWEST_SCORE`.

    The network may be on any device.
    """
    device = next(model.parameters()).device
    centres, strides = (grid.to(device) for grid in cells(*images.size))
    detections = []
    for first in range(0, len(images), BATCH):
        shown = torch.from_numpy(images.images[first : first + BATCH]).to(device)
        shown = shown.permute(0, 3, 1, 2).float().div_(255)
        output = model(shown.contiguous(memory_format=torch.channels_last))
        boxes, logits = decode(output, centres, strides)
        raw = zip(boxes.cpu().numpy(), logits.sigmoid().cpu().numpy(), strict=True)
        for image in raw:
            detections.append(reported("the network in training", *image, LOWEST_SCORE, IOU))
    return detections
