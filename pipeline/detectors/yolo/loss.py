"""Task-aligned assignment and the loss, for images with at most a single pedestrian."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

BOX_WEIGHT = 5.0
TOP = 5
"""Cells that take a box, at most."""
SCORE_POWER = 0.5
IOU_POWER = 4.0
REACH = 1.5
"""Strides around the box's centre within which a cell may take even a small box."""


@dataclass(frozen=True)
class Loss:
    """The losses of a batch, scalars.

    Attributes:
        total: what training minimises.
        scores: cross-entropy per unit of target score.
        boxes: 1 - GIoU, weighted by target score, in [0, 2].
    """

    total: Tensor
    scores: Tensor
    boxes: Tensor


def pairwise_iou(boxes: Tensor, truth: Tensor) -> tuple[Tensor, Tensor]:
    """IoU in [0, 1] and generalised IoU in [-1, 1] of boxes with the truth.

    Args:
        boxes: (..., 4) left, top, right, bottom.
        truth: of a shape that broadcasts.

    >>> iou, _ = pairwise_iou(torch.tensor([0.0, 0, 2, 2]), torch.tensor([1.0, 0, 3, 2]))
    >>> round(float(iou), 3)
    0.333
    """
    left_top = torch.maximum(boxes[..., :2], truth[..., :2])
    right_bottom = torch.minimum(boxes[..., 2:], truth[..., 2:])
    overlap = (right_bottom - left_top).clamp(min=0).prod(-1)
    area = (boxes[..., 2:] - boxes[..., :2]).clamp(min=0).prod(-1)
    truth_area = (truth[..., 2:] - truth[..., :2]).clamp(min=0).prod(-1)
    union = (area + truth_area - overlap).clamp(min=1e-6)
    hull_low = torch.minimum(boxes[..., :2], truth[..., :2])
    hull_high = torch.maximum(boxes[..., 2:], truth[..., 2:])
    hull = (hull_high - hull_low).clamp(min=0).prod(-1).clamp(min=1e-6)
    iou = overlap / union
    return iou, iou - (hull - union) / hull


@torch.no_grad()
def assign(
    boxes: Tensor, logits: Tensor, truth: Tensor, centres: Tensor, strides: Tensor
) -> Tensor:
    """Target score of every cell (Feng et al., TOOD, 2021, Eq. 1 and 5).

    The candidates are the cells with their centre in the true box or near its middle; the five best
    aligned ones (score and IoU) take the box. The target of the best aligned cell is the largest
    IoU among the five, the others' targets are proportionally smaller.

    Args:
        boxes: (n, cells, 4) in pixels.
        logits: (n, cells).
        truth: (n, 4) in pixels, zeros without a pedestrian.
        centres: (cells, 2) in pixels.
        strides: (cells,) in pixels.

    Returns:
        (n, cells), in [0, 1]; 0 for background.
    """
    iou, _ = pairwise_iou(boxes, truth[:, None])
    present = (truth[:, 2] > truth[:, 0]) & (truth[:, 3] > truth[:, 1])
    inside = (centres > truth[:, None, :2]).all(-1) & (centres < truth[:, None, 2:]).all(-1)
    middle = (truth[:, None, :2] + truth[:, None, 2:]) / 2
    near = ((centres - middle).abs() < REACH * strides[:, None]).all(-1)
    allowed = (inside | near) & present[:, None]
    aligned = logits.sigmoid().pow(SCORE_POWER) * iou.pow(IOU_POWER) * allowed
    best = aligned.topk(min(TOP, aligned.shape[1]), 1).indices
    chosen = torch.zeros_like(allowed).scatter_(1, best, True) & allowed & (aligned > 0)
    kept = aligned * chosen
    best_iou = (iou * chosen).amax(1, keepdim=True)
    return kept / kept.amax(1, keepdim=True).clamp(min=1e-12) * best_iou


def detection_loss(
    boxes: Tensor, logits: Tensor, truth: Tensor, centres: Tensor, strides: Tensor
) -> Loss:
    """Cross-entropy of the scores plus five times 1 - GIoU of the assigned boxes.

    Both are per unit of target score.

    Args: as for `assign`.
    """
    target = assign(boxes, logits, truth, centres, strides)
    norm = target.sum().clamp(min=1.0)
    scores = functional.binary_cross_entropy_with_logits(logits, target, reduction="sum") / norm
    rows, columns = torch.nonzero(target > 0, as_tuple=True)
    _, generalised = pairwise_iou(boxes[rows, columns], truth[rows])
    box = ((1 - generalised) * target[rows, columns]).sum() / norm
    return Loss(scores + BOX_WEIGHT * box, scores.detach(), box.detach())
