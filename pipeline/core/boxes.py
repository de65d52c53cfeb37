"""Axis-aligned boxes in an image: left, top, right, bottom in pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]


def iou(a: ArrayLike, b: ArrayLike) -> Floats:
    """Intersection over union of every box of `a` (n, 4) with every box of `b` (m, 4), as (n, m) in [0, 1].

    Boxes without an area overlap nothing.
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
    """Indices of the boxes that survive non-maximum suppression, best score first.

    boxes: (n, 4). scores: (n,). A box is removed if its IoU with a better surviving box exceeds `iou_threshold`, in [0, 1]. Of equal scores
    the first wins.
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
