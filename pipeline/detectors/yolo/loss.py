"""Task-aligned assignment and the loss, for images with at most one pedestrian each, as the base set has."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

BOX_WEIGHT = 5.0
TOP = 5
SCORE_POWER = 0.5
IOU_POWER = 4.0
REACH = 1.5
"""Strides around the box's centre within which a cell may take the box, however small the box is."""


@dataclass(frozen=True)
class Loss:
    """The losses of one batch, scalars. total: what training minimises. scores: cross-entropy per unit of target score. boxes: 1 - GIoU,
    weighted by target score, in [0, 2]."""

    total: Tensor
    scores: Tensor
    boxes: Tensor


def pairwise_iou(boxes: Tensor, truth: Tensor) -> tuple[Tensor, Tensor]:
    """IoU in [0, 1] and generalised IoU in [-1, 1] of boxes (..., 4) with truth of a shape that broadcasts."""
    left_top = torch.maximum(boxes[..., :2], truth[..., :2])
    right_bottom = torch.minimum(boxes[..., 2:], truth[..., 2:])
    overlap = (right_bottom - left_top).clamp(min=0).prod(-1)
    area = (boxes[..., 2:] - boxes[..., :2]).clamp(min=0).prod(-1)
    truth_area = (truth[..., 2:] - truth[..., :2]).clamp(min=0).prod(-1)
    union = (area + truth_area - overlap).clamp(min=1e-6)
    hull_low, hull_high = (
        torch.minimum(boxes[..., :2], truth[..., :2]),
        torch.maximum(boxes[..., 2:], truth[..., 2:]),
    )
    hull = (hull_high - hull_low).clamp(min=0).prod(-1).clamp(min=1e-6)
    iou = overlap / union
    return iou, iou - (hull - union) / hull


@torch.no_grad()
def assign(
    boxes: Tensor, logits: Tensor, truth: Tensor, centres: Tensor, strides: Tensor
) -> Tensor:
    """Target score (n, cells) in [0, 1] of every cell; 0 for background.

    boxes (n, cells, 4), logits (n, cells), truth (n, 4) with zeros without a pedestrian. The candidates are the cells with their centre in
    the true box or near its middle; the five best aligned ones (score and IoU) take the box. The best aligned one's target is the
    largest IoU among the five, the others' targets are proportionally smaller (Feng et al., TOOD, 2021, Eq. 1 and 5).
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
    """Binary cross-entropy of the scores plus five times 1 - GIoU of the assigned boxes, both per unit of target score.

    Shapes as in `assign`.
    """
    target = assign(boxes, logits, truth, centres, strides)
    norm = target.sum().clamp(min=1.0)
    scores = functional.binary_cross_entropy_with_logits(logits, target, reduction="sum") / norm
    rows, columns = torch.nonzero(target > 0, as_tuple=True)
    _, generalised = pairwise_iou(boxes[rows, columns], truth[rows])
    box = ((1 - generalised) * target[rows, columns]).sum() / norm
    return Loss(scores + BOX_WEIGHT * box, scores.detach(), box.detach())
