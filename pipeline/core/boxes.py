"""Axis-aligned boxes in an image: left, top, right, bottom in pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]


def iou(a: ArrayLike, b: ArrayLike) -> Floats:
    """Intersection over union of every box of `a` with every box of `b`.

    Args:
        a: (n, 4) boxes.
        b: (m, 4) boxes.

    Returns:
        (n, m) in [0, 1]; boxes without an area overlap nothing.

    >>> iou([[0, 0, 2, 2]], [[1, 0, 3, 2], [0, 0, 2, 2]]).round(3).tolist()
    [[0.333, 1.0]]
    """
    first, second = _boxes("a", a), _boxes("b", b)
    left_top = np.maximum(first[:, None, :2], second[None, :, :2])
    right_bottom = np.minimum(first[:, None, 2:], second[None, :, 2:])
    overlap = np.clip(right_bottom - left_top, 0, None).prod(axis=2)
    union = area(first)[:, None] + area(second)[None, :] - overlap
    result: Floats = np.divide(overlap, union, out=np.zeros_like(overlap), where=union > 0)
    return result


def area(boxes: ArrayLike) -> Floats:
    """Area of (n, 4) boxes as (n,), square pixels; 0 for a box turned inside out."""
    checked = _boxes("boxes", boxes)
    areas: Floats = np.clip(checked[:, 2:] - checked[:, :2], 0, None).prod(axis=1)
    return areas


def nms(boxes: ArrayLike, scores: ArrayLike, iou_threshold: float) -> NDArray[np.int64]:
    """Non-maximum suppression: drops a box that overlaps a better one too much.

    Args:
        boxes: (n, 4).
        scores: (n,); of equal scores the first wins.
        iou_threshold: a box is dropped if its IoU with a better kept box exceeds it, in [0, 1].

    Returns:
        Indices of the kept boxes, best score first.

    Raises:
        ValueError: wrong shapes.

    >>> nms([[0, 0, 2, 2], [0, 0, 2, 3], [5, 5, 6, 6]], [0.5, 0.9, 0.7], 0.5).tolist()
    [1, 2]
    """
    checked, weights = _boxes("boxes", boxes), np.asarray(scores, dtype=float)
    if weights.shape != (len(checked),):
        raise ValueError(f"scores must have shape ({len(checked)},), got {weights.shape}")
    order = np.argsort(-weights, kind="stable")
    kept: list[int] = []
    while len(order):
        best, rest = order[0], order[1:]
        kept.append(int(best))
        order = rest[iou(checked[best : best + 1], checked[rest])[0] <= iou_threshold]
    return np.array(kept, dtype=np.int64)


def _boxes(name: str, boxes: ArrayLike) -> Floats:
    array = np.asarray(boxes, dtype=float)
    if array.size == 0:
        return array.reshape(0, 4)
    if array.ndim != 2 or array.shape[1] != 4:
        raise ValueError(f"{name} must have shape (n, 4), got {array.shape}")
    return array
