"""Batches from images in memory: crops or full frames, flipped, scaled and re-lit.

All in OpenCV on uint8. A batch depends only on the seed and its number. Training can therefore stop
and resume anywhere, and workers may prepare batches ahead, without changing the result.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from pipeline.artefacts.dataset import ImageSet
from pipeline.detectors.layouts import GREY

Images = NDArray[np.uint8]
Boxes = NDArray[np.float32]
Change = Callable[[Images], Images]
SLIVER_PIXELS = 12
"""A pedestrian with fewer visible pixels is neither a fair positive nor a fair negative.

Its image is left out."""
SMALL_PIXELS = 60
"""A pedestrian with fewer visible pixels is hard."""
CENTRED = 0.62
"""Share of crops around a pedestrian. With such crops alone, false positives triple."""
KEPT_SHARE = 0.25
"""Share of a box that must remain in a crop; otherwise the crop is drawn again."""
ATTEMPTS = 8
"""Draws of a view before the whole frame is shown."""


@dataclass(frozen=True)
class View:
    """The part of an image to show.

    Attributes:
        centre: x and y in image pixels.
        scale: output pixels per image pixel.
        flipped: whether left and right are exchanged.
    """

    centre: tuple[float, float]
    scale: float
    flipped: bool


def usable(images: ImageSet) -> NDArray[np.int64]:
    """Indices of the images to train on.

    Their pedestrian has at least `SLIVER_PIXELS` visible pixels, or they show none.
    """
    return np.flatnonzero((images.visible_pixels == 0) | (images.visible_pixels >= SLIVER_PIXELS))


def hardness(images: ImageSet, oversampling: int) -> NDArray[np.int64]:
    """Number of times that an epoch shows each image.

    Hard means: under 60 visible pixels; so near that the box fills over half the height or touches
    an image side; hardly darker or brighter than its surroundings (under 16 grey levels); or in a
    wide pose (over three quarters as wide as tall).

    Args:
        images: n images.
        oversampling: number of times for an image with a hard pedestrian; others are shown once.

    Returns:
        (n,).
    """
    width, height = images.size
    left, top, right, bottom = images.boxes.T
    small = images.visible_pixels < SMALL_PIXELS
    near = (bottom - top > height / 2) | (left <= 1) | (right >= width - 1)
    faint = images.contrast < 16
    wide = right - left > 0.75 * (bottom - top)
    hard = (images.visible_pixels > 0) & (small | near | faint | wide)
    return np.where(hard, oversampling, 1).astype(np.int64)


class Stream:
    """An endless order of image indices, shuffled anew each epoch.

    Args:
        indices: (n,) of images.
        repeats: (n,) number of times that each index comes in an epoch.
        seed: of the order.

    Raises:
        ValueError: without images.

    >>> stream = Stream(np.array([3, 5]), np.array([1, 1]), seed=(0,))
    >>> sorted(stream.take(0, 2).tolist()), sorted(stream.take(2, 2).tolist())
    ([3, 5], [3, 5])
    """

    def __init__(
        self, indices: NDArray[np.int64], repeats: NDArray[np.int64], seed: tuple[int, ...]
    ) -> None:
        self._pool = np.repeat(indices, repeats)
        if not len(self._pool):
            raise ValueError("a stream needs at least one image, got none")
        self._seed = seed
        self._epochs: dict[int, NDArray[np.int64]] = {}

    def take(self, start: int, count: int) -> NDArray[np.int64]:
        """The indices at positions start, start + 1, ... of the order, (count,)."""
        size = len(self._pool)
        parts = []
        while count > 0:
            epoch, offset = divmod(start, size)
            # Several threads may take; they then shuffle the same epoch alike.
            before, order = self._epochs, self._epochs.get(epoch)
            if order is None:
                order = np.random.default_rng((*self._seed, epoch)).permutation(self._pool)
                latest = {key: value for key, value in before.items() if key == epoch - 1}
                self._epochs = latest | {epoch: order}
            part = order[offset : offset + count]
            parts.append(part)
            start, count = start + len(part), count - len(part)
        return np.concatenate(parts) if parts else np.zeros(0, np.int64)


def crop_view(
    box: Boxes, size: tuple[int, int], crop: tuple[int, int], rng: np.random.Generator
) -> View:
    """Choose a crop.

    It is around the pedestrian with a probability of `CENTRED`, if there is a pedestrian; otherwise
    anywhere around the horizon.

    Args:
        box: (4,) of the pedestrian in pixels, zeros for none.
        size: width and height of the image.
        crop: width and height of the crop.
        rng: source of all random draws.
    """
    scale = float(np.exp(rng.uniform(-0.25, 0.35))) if rng.random() < 0.6 else 1.0
    half = np.array(crop) / 2 / scale
    aim, jitter, place = rng.random(), rng.uniform(-1, 1, 2), rng.random(2)
    if box[2] > box[0] and aim < CENTRED:
        centre = np.array([box[0] + box[2], box[1] + box[3]]) / 2 + jitter * (0.8, 0.6) * half
    else:
        centre = np.array([place[0] * size[0], (0.15 + 0.75 * place[1]) * size[1]])
    low = np.minimum(half, np.array(size) / 2)
    centre = np.clip(centre, low, np.array(size) - low)
    return View((float(centre[0]), float(centre[1])), scale, bool(rng.random() < 0.5))


def frame_view(size: tuple[int, int], rng: np.random.Generator) -> View:
    """The whole frame of size (w, h).

    In 60 % of the cases it is scaled by 0.85 to 1.25 and moved by up to a twelfth.
    """
    zoom, jitter = rng.random() < 0.6, rng.uniform(-1, 1, 2)
    scale = float(np.exp(rng.uniform(-0.16, 0.22))) if zoom else 1.0
    centre = np.array(size) * (0.5 + (jitter / 12 if zoom else 0))
    return View((float(centre[0]), float(centre[1])), scale, bool(rng.random() < 0.5))


def on_pixels(view: View, size: tuple[int, int]) -> View:
    """The view for size (w, h), moved to whole pixels unless it is scaled."""
    if view.scale != 1.0:
        return view
    left, top = round(view.centre[0] - size[0] / 2), round(view.centre[1] - size[1] / 2)
    return View((left + size[0] / 2, top + size[1] / 2), 1.0, view.flipped)


def mapping(view: View, size: tuple[int, int]) -> NDArray[np.float64]:
    """The (2, 3) matrix that maps image points to a view of size (w, h)."""
    sign = -view.scale if view.flipped else view.scale
    return np.array(
        [
            [sign, 0, size[0] / 2 - sign * view.centre[0]],
            [0, view.scale, size[1] / 2 - view.scale * view.centre[1]],
        ]
    )


def show(image: Images, view: View, size: tuple[int, int]) -> Images:
    """The view of an image as (h, w, 3) for size (w, h)."""
    width, height = size
    left, top = int(view.centre[0] - width / 2), int(view.centre[1] - height / 2)
    if (
        view.scale == 1.0
        and 0 <= left <= image.shape[1] - width
        and 0 <= top <= image.shape[0] - height
    ):
        part = image[top : top + height, left : left + width]
        return np.asarray(cv2.flip(part, 1), np.uint8) if view.flipped else part
    centred = mapping(view, size)
    # OpenCV puts (0, 0) at a pixel's middle, boxes at its corner.
    centred[:, 2] += centred[:, :2] @ (0.5, 0.5) - 0.5
    # Grey beyond the image: a reflection would show unlabelled people.
    shown = cv2.warpAffine(image, centred, size, flags=cv2.INTER_LINEAR, borderValue=(GREY,) * 3)
    return np.asarray(shown, np.uint8)


def shown_box(
    box: Boxes, matrix: NDArray[np.float64], size: tuple[int, int]
) -> tuple[Boxes, float]:
    """The box in a view.

    Args:
        box: (4,) in pixels of the image, zeros for none.
        matrix: (2, 3) from `mapping`.
        size: width and height of the view.

    Returns:
        The box (4,), clipped to the view, zeros if nothing remains; and the remaining share of its
        area, in [0, 1].
    """
    if box[2] <= box[0]:
        return np.zeros(4, np.float32), 1.0
    x = np.sort(matrix[0, 0] * box[[0, 2]] + matrix[0, 2])
    y = matrix[1, 1] * box[[1, 3]] + matrix[1, 2]
    area = (x[1] - x[0]) * (y[1] - y[0])
    x, y = x.clip(0, size[0]), y.clip(0, size[1])
    left = (x[1] - x[0]) * (y[1] - y[0]) / max(area, 1e-9)
    if left <= 0:
        return np.zeros(4, np.float32), 0.0
    return np.array([x[0], y[0], x[1], y[1]], np.float32), float(left)


def recolouring(rng: np.random.Generator) -> Change:
    """A change of the colours in half of the cases: hues rotated, saturation scaled.

    Cars and clothes have any colour.
    """
    if rng.random() < 0.5:
        return lambda image: image
    turn, scale = int(rng.integers(180)), rng.uniform(0.4, 1.4)
    levels = np.arange(256)
    hue, saturation = (levels + turn) % 180, np.clip(levels * scale, 0, 255)
    curves = np.stack([hue, saturation, levels], axis=1).astype(np.uint8)

    def change(image: Images) -> Images:
        changed = cv2.LUT(cv2.cvtColor(image, cv2.COLOR_RGB2HSV), curves[None])
        return np.asarray(cv2.cvtColor(changed, cv2.COLOR_HSV2RGB), np.uint8)

    return change


def relighting(rng: np.random.Generator) -> Change:
    """A change of the exposure: gain and offset.

    In half of the cases the tint changes, too; in 30 %, haze reduces the contrast.
    """
    gain, offset = rng.uniform(0.6, 1.45), rng.uniform(-20, 20)
    tint = rng.uniform(0.85, 1.15, 3) if rng.random() < 0.5 else np.ones(1)
    clear, haze = (rng.uniform(0.4, 1), rng.uniform(20, 220)) if rng.random() < 0.3 else (1.0, 0.0)
    exposed = np.clip((np.arange(256)[:, None] * gain + offset) * tint, 0, 255)
    # A curve for each channel, or the same for all, which is twice as fast.
    curve = (clear * exposed + (1 - clear) * haze).astype(np.uint8)
    return lambda image: np.asarray(cv2.LUT(image, curve[None]), np.uint8)


def augmented(
    box: Boxes, full: tuple[int, int], size: tuple[int, int], relit: float, rng: np.random.Generator
) -> tuple[Change, Boxes]:
    """How an image becomes a training example, and its box.

    Args:
        box: (4,) of the pedestrian in pixels, zeros for none.
        full: width and height of the image.
        size: width and height of the example: the frame if equal to `full`, else a crop.
        relit: probability of other colours and light, in [0, 1].
        rng: source of all random draws.

    Returns:
        The change from the image to the example, and the box (4,) in its pixels.
    """
    for _ in range(ATTEMPTS):
        view = frame_view(full, rng) if size == full else crop_view(box, full, size, rng)
        view = on_pixels(view, size)
        label, left = shown_box(box, mapping(view, size), size)
        if left == 0 or left > KEPT_SHARE:
            break
    else:
        view = on_pixels(View((full[0] / 2, full[1] / 2), 1.0, False), size)
        label, _ = shown_box(box, mapping(view, size), size)
    if rng.random() >= relit:
        return lambda image: show(image, view, size), label
    recolour, relight = recolouring(rng), relighting(rng)
    return lambda image: relight(recolour(show(image, view, size))), label


def batch(
    images: ImageSet,
    indices: NDArray[np.int64],
    size: tuple[int, int],
    seed: tuple[int, ...],
    relit: float = 1.0,
) -> tuple[Images, Boxes]:
    """Training examples of a batch.

    Args:
        images: to choose from.
        indices: (n,) of the images to show.
        size: width and height of the examples.
        seed: of all random draws of the batch.
        relit: share of the examples with other colours and light, in [0, 1].

    Returns:
        Images (n, h, w, 3) uint8 RGB, and boxes (n, 4) in their pixels, zeros without a pedestrian.
    """
    rng = np.random.default_rng(seed)
    # All draws come first, so that several threads may then work on the pixels.
    examples = [augmented(images.boxes[index], images.size, size, relit, rng) for index in indices]
    shown = np.empty((len(indices), size[1], size[0], 3), np.uint8)

    def fill(rows: range) -> None:
        for row in rows:
            shown[row] = examples[row][0](images.images[indices[row]])

    threads = torch.get_num_threads()
    others = []
    for start in range(1, threads):
        others.append(_pool(threads).submit(fill, range(start, len(indices), threads)))
    fill(range(0, len(indices), threads))
    for other in others:
        other.result()
    return shown, np.array([box for _, box in examples], np.float32).reshape(-1, 4)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads)
