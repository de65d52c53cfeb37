"""Hand-computed overlaps."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.boxes import area, iou, nms


def test_iou_of_hand_computed_boxes() -> None:
    overlaps = iou([[0, 0, 2, 2]], [[0, 0, 2, 2], [1, 1, 3, 3], [2, 0, 4, 2], [0, 0, 2, 1]])
    assert np.allclose(overlaps, [[1, 1 / 7, 0, 1 / 2]])


def test_boxes_without_area_overlap_nothing() -> None:
    assert iou([[1, 1, 1, 1]], [[1, 1, 1, 1], [0, 0, 2, 2]]).tolist() == [[0, 0]]
    assert area([[3, 3, 1, 1], [0, 0, 2, 3]]).tolist() == [0, 6]


def test_iou_of_nothing_has_the_right_shape() -> None:
    assert iou([], [[0, 0, 1, 1]]).shape == (0, 1)
    assert iou([[0, 0, 1, 1]], []).shape == (1, 0)


def test_nms_keeps_the_best_of_each_group_and_the_first_of_equals() -> None:
    boxes = [[0, 0, 10, 10], [1, 0, 11, 10], [20, 0, 30, 10], [20, 0, 30, 10]]
    assert nms(boxes, [0.5, 0.9, 0.7, 0.7], 0.5).tolist() == [1, 2]
    assert nms(boxes, [0.5, 0.9, 0.7, 0.7], 1.0).tolist() == [1, 2, 3, 0]
    assert nms([], [], 0.5).tolist() == []


def test_wrong_shapes_are_named() -> None:
    with pytest.raises(ValueError, match=r"a must have shape \(n, 4\), got \(1, 3\)"):
        iou([[0, 0, 1]], [[0, 0, 1, 1]])
    with pytest.raises(ValueError, match="scores must have shape"):
        nms([[0, 0, 1, 1]], [0.1, 0.2], 0.5)
