from __future__ import annotations

import math

import pytest
import torch

from pipeline.detectors.yolo.loss import TOP, assign, detection_loss, pairwise_iou
from pipeline.detectors.yolo.network import cells

CENTRES, STRIDES = cells(64, 64)
TRUTH = torch.tensor([[16.0, 8.0, 40.0, 56.0]])
NOBODY = torch.zeros(1, 4)


def guesses(box: torch.Tensor) -> torch.Tensor:
    return box.expand(1, len(CENTRES), 4).clone()


def test_iou_by_hand() -> None:
    iou, generalised = pairwise_iou(torch.tensor([0.0, 0, 2, 2]), torch.tensor([1.0, 0, 3, 2]))
    assert iou.item() == pytest.approx(1 / 3)
    assert generalised.item() == pytest.approx(1 / 3)
    iou, generalised = pairwise_iou(torch.tensor([0.0, 0, 1, 1]), torch.tensor([3.0, 0, 4, 1]))
    assert iou.item() == 0
    assert generalised.item() == pytest.approx(-0.5)


def test_no_cell_is_assigned_without_a_pedestrian() -> None:
    assert (
        assign(
            guesses(TRUTH), torch.zeros(1, len(CENTRES)), NOBODY, CENTRES, STRIDES
        ).count_nonzero()
        == 0
    )


def test_the_best_aligned_cells_take_the_box() -> None:
    logits = torch.zeros(1, len(CENTRES))
    boxes = guesses(torch.tensor([16.0, 8.0, 40.0, 32.0]))
    inside = int(torch.argmin((CENTRES - torch.tensor([28.0, 36.0])).abs().sum(1)))
    boxes[0, inside] = TRUTH[0]
    target = assign(boxes, logits, TRUTH, CENTRES, STRIDES)
    assert target.count_nonzero() == TOP
    assert target.argmax() == inside
    assert target.max() == pytest.approx(1.0)
    rest = target[target > 0].sort().values[:-1]
    assert rest.tolist() == pytest.approx([0.5**4] * (TOP - 1))


def test_cells_far_from_the_box_never_take_it() -> None:
    centres, strides = cells(256, 256)
    near = torch.tensor([[10.0, 10.0, 30.0, 50.0]])
    # All cells predict the box, and those far from it have the highest scores.
    sure = torch.where((centres > 128).any(1), 5.0, 0.0)[None]
    target = assign(near.expand(1, len(centres), 4).clone(), sure, near, centres, strides)
    taken = centres[target[0] > 0]
    assert len(taken) == TOP
    assert ((taken - torch.tensor([20.0, 30.0])).abs() < 48).all()


def test_a_box_smaller_than_a_cell_is_taken() -> None:
    small = torch.tensor([[17.0, 17.0, 19.0, 20.0]])
    distance = (CENTRES - (small[0, :2] + small[0, 2:]) / 2).abs()
    assert not (distance < (small[0, 2:] - small[0, :2]) / 2).all(1).any()
    assert (
        assign(
            guesses(small), torch.zeros(1, len(CENTRES)), small, CENTRES, STRIDES
        ).count_nonzero()
        > 0
    )


def test_loss_is_near_zero_for_a_perfect_answer_only() -> None:
    boxes = guesses(TRUTH)
    target = assign(boxes, torch.zeros(1, len(CENTRES)), TRUTH, CENTRES, STRIDES)
    perfect = detection_loss(boxes, torch.where(target > 0, 12.0, -12.0), TRUTH, CENTRES, STRIDES)
    blind = detection_loss(boxes, torch.full_like(target, -12.0), TRUTH, CENTRES, STRIDES)
    assert perfect.total < 0.01 < 1 < blind.total
    moved = detection_loss(boxes + 6, torch.where(target > 0, 12.0, -12.0), TRUTH, CENTRES, STRIDES)
    assert moved.boxes > 0.2


def test_gradients_flow_to_boxes_and_scores() -> None:
    boxes, logits = (
        (guesses(TRUTH) + 4).requires_grad_(),
        torch.zeros(1, len(CENTRES), requires_grad=True),
    )
    loss = detection_loss(boxes, logits, TRUTH, CENTRES, STRIDES)
    loss.total.backward()  # type: ignore[no-untyped-call]
    assert boxes.grad is not None
    assert logits.grad is not None
    assert boxes.grad.count_nonzero() > 0
    assert logits.grad.count_nonzero() == logits.numel()


def test_a_batch_without_pedestrians_has_a_finite_loss() -> None:
    loss = detection_loss(guesses(TRUTH), torch.zeros(1, len(CENTRES)), NOBODY, CENTRES, STRIDES)
    assert torch.isfinite(loss.total)
    assert loss.boxes == 0


def test_the_loss_by_hand() -> None:
    """All cells show half of the box, so the five that take it have a target of 0.5 each."""
    boxes, logits = guesses(torch.tensor([[16.0, 8.0, 40.0, 32.0]])), torch.zeros(1, len(CENTRES))
    target = assign(boxes, logits, TRUTH, CENTRES, STRIDES)
    assert target[target > 0].tolist() == pytest.approx([0.5] * TOP)
    loss = detection_loss(boxes, logits, TRUTH, CENTRES, STRIDES)
    assert loss.scores.item() == pytest.approx(len(CENTRES) * math.log(2) / 2.5)
    assert loss.boxes.item() == pytest.approx(0.5)
    assert loss.total.item() == pytest.approx(loss.scores.item() + 5 * 0.5)


def test_of_equal_boxes_the_one_with_the_highest_score_is_best_aligned() -> None:
    logits = torch.zeros(1, len(CENTRES))
    inside = int(torch.argmin((CENTRES - torch.tensor([28.0, 36.0])).abs().sum(1)))
    logits[0, inside] = 4.0
    target = assign(guesses(TRUTH), logits, TRUTH, CENTRES, STRIDES)
    assert target.argmax() == inside
    assert target[target > 0].sort().values.tolist() == pytest.approx(
        [(0.5 * (1 + math.exp(-4))) ** 0.5] * (TOP - 1) + [1]
    )
