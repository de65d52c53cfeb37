from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from pipeline.artefacts.dataset import ImageSet, image_set
from pipeline.detectors.yolo.data import (
    Stream,
    View,
    batch,
    hardness,
    mapping,
    on_pixels,
    recolouring,
    show,
    shown_box,
    usable,
)
from tests.data_sets import SCENE_SIZE, scene


def people() -> ImageSet:
    return image_set(
        [scene((60, 30, 76, 66)), scene(None), scene((10, 40, 20, 64)), scene((90, 20, 104, 60))]
    )


def coloured(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """The box of the pixels that are not grey; a tint gives grey a chroma of 31 at most."""
    chroma = image.max(2).astype(int) - image.min(2)
    rows, columns = np.nonzero(chroma > max(31, chroma.max() / 2))
    return (
        np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], float)
        if len(rows)
        else np.zeros(4)
    )


@pytest.mark.parametrize("size", [SCENE_SIZE, (64, 64)])
def test_boxes_follow_the_pixels(size: tuple[int, int]) -> None:
    for seed in range(20):
        shown, boxes = batch(people(), np.arange(4), size, (seed,), relit=0.0)
        assert shown.shape == (4, size[1], size[0], 3)
        for image, box in zip(shown, boxes, strict=True):
            assert coloured(image) == pytest.approx(box, abs=1.6)


def test_a_batch_depends_on_its_seed_alone() -> None:
    first, again, other = (batch(people(), np.arange(4), (64, 64), (seed, 3)) for seed in (1, 1, 2))
    assert np.array_equal(first[0], again[0])
    assert np.array_equal(first[1], again[1])
    assert not np.array_equal(first[0], other[0])


def test_a_batch_is_the_same_with_any_number_of_threads() -> None:
    before = torch.get_num_threads()
    try:
        batches = []
        for threads in (1, 2, 3, 7):
            torch.set_num_threads(threads)
            batches.append(batch(people(), np.arange(4), (64, 64), (1, 3)))
    finally:
        torch.set_num_threads(before)
    for images, boxes in batches[1:]:
        assert np.array_equal(images, batches[0][0]) and np.array_equal(boxes, batches[0][1])


def test_only_a_share_of_the_examples_is_relit() -> None:
    original = {tuple(colour) for image in people().images for colour in image.reshape(-1, 3)}
    for share, low, high in ((0.0, 0, 0), (0.5, 60, 140), (1.0, 150, 200)):
        shown = batch(
            people().take(np.array([1])), np.zeros(200, np.int64), SCENE_SIZE, (0,), share
        )[0]
        # Grey frames change by light alone; warps may add the border's grey.
        changed = sum(tuple(image[48, 64]) not in original for image in shown)
        assert low <= changed <= high


def test_recolouring_rotates_hues_and_keeps_brightness() -> None:
    image, _ = scene((10, 40, 20, 64))
    shown = [recolouring(np.random.default_rng(seed))(image) for seed in range(40)]
    colours = {tuple(picture[50, 15]) for picture in shown}
    assert {(250, 20, 20)} < colours
    assert len(colours) > 10
    assert {max(colour) for colour in colours} == {250}
    assert all((picture[0, 0] == 30).all() for picture in shown)


def test_flipping_mirrors_image_and_box() -> None:
    image, truth = scene((10, 40, 20, 64))
    view = View((64, 48), 1.0, True)
    assert np.array_equal(show(image, view, SCENE_SIZE), image[:, ::-1])
    box, left = shown_box(
        np.array(truth.visible_box, np.float32), mapping(view, SCENE_SIZE), SCENE_SIZE
    )
    assert box.tolist() == [108, 40, 118, 64]
    assert left == 1


@pytest.mark.parametrize("size", [SCENE_SIZE, (64, 64)])
def test_half_of_the_examples_are_flipped(size: tuple[int, int]) -> None:
    image, truth = scene((60, 30, 76, 66))
    image[30:66, 60:68] = (20, 20, 250)  # Its left half is blue.
    shown, boxes = batch(
        image_set([(image, truth)]), np.zeros(100, np.int64), size, (0,), relit=0.0
    )
    whole = boxes[:, 2] - boxes[:, 0] > 12
    blue = np.array([np.argwhere(example[..., 2] > 200)[:, 1].mean() for example in shown[whole]])
    assert 0.3 < (blue > (boxes[whole, 0] + boxes[whole, 2]) / 2).mean() < 0.7


def test_a_crop_that_cuts_a_pedestrian_to_less_than_a_quarter_is_drawn_again() -> None:
    boxes = batch(people().take(np.array([0])), np.zeros(400, np.int64), (32, 32), (0,), relit=0.0)[
        1
    ]
    left, top, right, bottom = boxes[boxes[:, 2] > boxes[:, 0]].T
    smallest = 16 * 36 * np.exp(-0.25) ** 2  # The whole box at the smallest scale.
    assert ((right - left) * (bottom - top)).min() > 0.25 * smallest


def test_a_cut_box_keeps_its_visible_part() -> None:
    _, truth = scene((10, 40, 20, 64))
    matrix = mapping(on_pixels(View((47.2, 48), 1.0, False), (64, 64)), (64, 64))
    box, left = shown_box(np.array(truth.visible_box, np.float32), matrix, (64, 64))
    assert box.tolist() == [0, 24, 5, 48]
    assert left == pytest.approx(0.5)


def test_crops_show_people_and_empty_places() -> None:
    boxes = batch(people().take(np.array([2])), np.zeros(200, np.int64), (32, 32), (0,))[1]
    assert 0.5 < (boxes[:, 2] > 0).mean() < 0.95


def test_tiny_pedestrians_are_left_out_and_hard_ones_repeated() -> None:
    images = image_set(
        [
            scene((60, 30, 64, 40), pixels=11),
            scene((60, 30, 64, 40), pixels=12),
            scene(None),
            scene((40, 20, 60, 60)),
        ]
    )
    assert usable(images).tolist() == [1, 2, 3]
    assert hardness(images, 3).tolist() == [3, 3, 1, 1]
    near = image_set([scene((40, 10, 70, 90)), scene((0, 30, 20, 60))])
    assert hardness(near, 2).tolist() == [2, 2]


def test_each_kind_of_hard_image_is_repeated() -> None:
    area = (48, 20, 68, 60)
    plain = scene(area)[1]
    plain, faint = replace(plain, contrast=16.0), replace(plain, contrast=15.9)
    wide, right, tall = (
        scene(box)[1] for box in ((40, 20, 71, 60), (100, 20, 127, 60), (40, 20, 60, 69))
    )
    images = image_set([(scene(area)[0], truth) for truth in (plain, faint, wide, right, tall)])
    assert hardness(images, 3).tolist() == [1, 3, 3, 3, 3]


def test_a_stream_shows_everything_once_an_epoch_from_any_start() -> None:
    stream = Stream(np.array([3, 5, 8]), np.array([1, 2, 1]), (0,))
    order = stream.take(0, 12)
    for epoch in order.reshape(3, 4):
        assert sorted(epoch) == [3, 5, 5, 8]
    again = Stream(np.array([3, 5, 8]), np.array([1, 2, 1]), (0,))
    assert np.array_equal(np.concatenate([again.take(start, 3) for start in (0, 3, 6, 9)]), order)
    assert np.array_equal(
        Stream(np.array([3, 5, 8]), np.array([1, 2, 1]), (0,)).take(5, 4), order[5:9]
    )
    with pytest.raises(ValueError, match="^a stream needs at least one image, got none$"):
        Stream(np.zeros(0, np.int64), np.zeros(0, np.int64), (0,))
