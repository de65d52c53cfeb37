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
    """Average precision on some validation images, at intervals."""
    chosen = images.take(
        np.linspace(0, len(images) - 1, min(EVALUATED, len(images))).astype(np.int64)
    )
    return Validation(lambda model: average_precision(model, chosen), every, patience)


def average_precision(model: Yolo, images: ImageSet) -> float:
    """AP50 of visible pedestrians, in [0, 1]; the network may be on any device."""
    return evaluate(detected(model, images), images, threshold=0.5)["ap50"]


@torch.inference_mode()
def detected(model: Yolo, images: ImageSet) -> list[Detections]:
    """Detections in each image, with scores from 0.005; the network may be on any device."""
    device = next(model.parameters()).device
    centres, strides = (grid.to(device) for grid in cells(*images.size))
    found = []
    for first in range(0, len(images), BATCH):
        shown = (
            torch.from_numpy(images.images[first : first + BATCH])
            .to(device)
            .permute(0, 3, 1, 2)
            .float()
            .div_(255)
        )
        boxes, logits = decode(
            model(shown.contiguous(memory_format=torch.channels_last)), centres, strides
        )
        found += [
            reported("the network in training", b, s, LOWEST_SCORE, IOU)
            for b, s in zip(boxes.cpu().numpy(), logits.sigmoid().cpu().numpy(), strict=True)
        ]
    return found
