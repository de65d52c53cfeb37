"""Pedestrians, images and detections for tests of detectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.artefacts.dataset import ImageSet
from pipeline.core.detections import Detections
from pipeline.core.truth import Truth

PERSON = (20.0, 10.0, 40.0, 50.0)
BESIDE = (20.0, 30.0, 40.0, 70.0)
"""A box shifted by half of the person's height: IoU 1/3."""
AWAY = (70.0, 10.0, 90.0, 50.0)
NONE = (0.0, 0.0, 0.0, 0.0)
VISIBLE, TINY, PALE, EMPTY = (
    (PERSON, 800, 50.0),
    (PERSON, 20, 50.0),
    (PERSON, 800, 4.0),
    (NONE, 0, 0.0),
)
"""Pedestrians: box, visible pixels, contrast."""
SCENE_SIZE = (128, 96)
"""Width and height of a scene, px."""


def images(*people: tuple[tuple[float, ...], int, float]) -> ImageSet:
    """Black images, each with a pedestrian such as VISIBLE."""
    boxes = np.array([box for box, _, _ in people], np.float32)
    pixels = np.array([pixels for _, pixels, _ in people])
    contrast = np.array([contrast for _, _, contrast in people], np.float32)
    return ImageSet(np.zeros((len(people), 96, 128, 3), np.uint8), boxes, boxes, pixels, contrast)


def detected(*pairs: tuple[tuple[float, ...], float]) -> Detections:
    """The detections in an image, from pairs of box and score."""
    return Detections(
        np.array([box for box, _ in pairs], np.float32).reshape(-1, 4),
        np.array([score for _, score in pairs], np.float32),
    )


def scene(
    box: tuple[int, int, int, int] | None, pixels: int | None = None
) -> tuple[NDArray[np.uint8], Truth]:
    """A dark image with a bright red rectangle where the pedestrian is."""
    image = np.full((SCENE_SIZE[1], SCENE_SIZE[0], 3), 30, np.uint8)
    if box is None:
        return image, Truth()
    left, top, right, bottom = box
    image[top:bottom, left:right] = (250, 20, 20)
    area = (right - left) * (bottom - top) if pixels is None else pixels
    truth = tuple(float(value) for value in box)
    return image, Truth(truth, truth, area, area, 60.0)  # type: ignore[arg-type]
