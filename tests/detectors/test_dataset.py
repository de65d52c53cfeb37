from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.artefacts.dataset import (
    ImageSet,
    Record,
    decode_jpeg,
    encode_jpeg,
    image_path,
    image_set,
    read_dataset,
    remove_leftovers,
    write_image,
    write_truth,
)
from pipeline.core.truth import Truth
from pipeline.errors import InputError

WIDTH, HEIGHT = 64, 32
SHOWN = Truth((8.0, 4.0, 16.0, 20.0), (8.0, 4.0, 16.0, 24.0), 90, 120, 22.5)
HIDDEN = Truth(None, (1.0, 2.0, 5.0, 12.0), 0, 40)
EMPTY = Truth()


def image(seed: int) -> NDArray[np.uint8]:
    smooth = np.linspace(0, 200, WIDTH)[None, :, None] + np.random.default_rng(seed).integers(
        0, 50, 3
    )
    return np.broadcast_to(smooth, (HEIGHT, WIDTH, 3)).astype(np.uint8)


def write(root: Path) -> None:
    records = []
    for index, (split, truth) in enumerate(
        [("val", EMPTY), ("train", SHOWN), ("train", HIDDEN), ("val", SHOWN)]
    ):
        write_image(root, split, index, image(index), truth)  # type: ignore[arg-type]
        values = {"fog": 10.0, "animation": "walking"}
        records.append(Record(split, index, WIDTH, HEIGHT, truth, values))  # type: ignore[arg-type]
    write_truth(root, records)


def test_a_data_set_survives_a_round_trip(tmp_path: Path) -> None:
    write(tmp_path)
    train = read_dataset(tmp_path, "train")
    assert train.images.shape == (2, HEIGHT, WIDTH, 3)
    assert train.size == (WIDTH, HEIGHT)
    assert train.boxes.tolist() == [[8, 4, 16, 20], [0, 0, 0, 0]]
    assert train.whole_boxes.tolist() == [[8, 4, 16, 24], [1, 2, 5, 12]]
    assert train.visible_pixels.tolist() == [90, 0]
    assert train.contrast.tolist() == [22.5, 0]
    assert np.abs(train.images[0].astype(int) - image(1)).mean() < 2


def test_the_digest_depends_on_the_content_alone(tmp_path: Path) -> None:
    write(tmp_path / "a")
    write(tmp_path / "b")
    first = read_dataset(tmp_path / "a", "train").digest
    assert first == read_dataset(tmp_path / "b", "train").digest
    write_image(tmp_path / "b", "train", 1, image(9), SHOWN)
    assert first != read_dataset(tmp_path / "b", "train").digest


def test_images_of_an_earlier_set_and_of_a_killed_writer_are_removed(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "segments").mkdir()
    for name in ("images/train/.000001.jpg.12345.tmp", "segments/.classes.json.12345.tmp"):
        (tmp_path / name).write_bytes(b"half")
    remove_leftovers(tmp_path, [Record("train", 1, WIDTH, HEIGHT, SHOWN, {})])
    left = {
        str(path.relative_to(tmp_path))
        for path in tmp_path.rglob("*")
        if path.is_file() and path.parent != tmp_path
    }
    assert left == {"images/train/000001.jpg", "labels/train/000001.txt"}


def test_truth_file_is_coco(tmp_path: Path) -> None:
    write(tmp_path)
    plain = json.loads((tmp_path / "truth.coco.json").read_text())
    assert [i["file_name"] for i in plain["images"]] == [
        f"train/{1:06d}.jpg",
        f"train/{2:06d}.jpg",
        "val/000000.jpg",
        "val/000003.jpg",
    ]
    annotation = plain["annotations"][0]
    assert annotation["bbox"] == [8, 4, 8, 16]
    assert annotation["area"] == 128
    assert annotation["iscrowd"] == 0
    assert annotation["whole_bbox"] == [8, 4, 8, 20]
    assert [a["id"] for a in plain["annotations"]] == [1, 2]
    assert {a["image_id"] for a in plain["annotations"]} == {
        plain["images"][0]["id"],
        plain["images"][3]["id"],
    }
    assert plain["images"][1]["hidden_bbox"] == [1, 2, 4, 10]
    assert plain["images"][0]["attributes"] == {"fog": 10.0, "animation": "walking"}


def test_labels_are_yolo(tmp_path: Path) -> None:
    write(tmp_path)
    label = (tmp_path / "labels/train/000001.txt").read_text().split()
    assert [float(value) for value in label] == [0, 12 / 64, 12 / 32, 8 / 64, 16 / 32]
    assert (tmp_path / "labels/train/000002.txt").read_text() == ""
    assert "train: images/train" in (tmp_path / "dataset.yaml").read_text()


def test_jpeg_repeats_and_refuses_other_bytes() -> None:
    assert encode_jpeg(image(0)) == encode_jpeg(image(0))
    assert decode_jpeg(encode_jpeg(image(0))).shape == (HEIGHT, WIDTH, 3)
    for data in (b"", b"no image"):
        with pytest.raises(ValueError, match="^the bytes are not a JPEG image$"):
            decode_jpeg(data)


@pytest.mark.parametrize(
    "damage", [lambda path: path.unlink(), lambda path: path.write_bytes(path.read_bytes()[:10])]
)
def test_damaged_image_is_named(tmp_path: Path, damage: Callable[[Path], object]) -> None:
    write(tmp_path)
    damage(image_path(tmp_path, "train", 1))
    with pytest.raises(
        InputError,
        match=r"000001\.jpg: expected a (JPEG image|readable file), got .*; \./run makes ",
    ):
        read_dataset(tmp_path, "train")


def test_other_size_is_named(tmp_path: Path) -> None:
    write(tmp_path)
    write_image(tmp_path, "train", 1, image(0)[:16], SHOWN)
    with pytest.raises(InputError, match=r"000001\.jpg must be 64x32, got 64x16$"):
        read_dataset(tmp_path, "train")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", " is not the truth file of a data set (KeyError('images')); ./run makes it again"),
        ('{"images": [{}], "annotations": []}', " is not the truth file of a data set (KeyError("),
        ("[]", " is not the truth file of a data set (TypeError("),
        ("{", ": expected JSON, got a truncated or foreign file"),
        (
            '{"images": [], "annotations": []}',
            " has no images of the split 'train'; it needs more images",
        ),
    ],
)
def test_foreign_truth_is_named(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "truth.coco.json").write_text(text)
    with pytest.raises(InputError, match=r"truth\.coco\.json" + re.escape(message)):
        read_dataset(tmp_path, "train")


def test_image_set_checks_shapes() -> None:
    whole = image_set([(image(0), SHOWN), (image(1), EMPTY)])
    assert len(whole.take(np.array([1]))) == 1
    assert whole.take(np.array([1])).visible_pixels.tolist() == [0]
    with pytest.raises(ValueError, match=r"^boxes must have shape \(2, 4\), got \(1, 4\)$"):
        ImageSet(
            whole.images, whole.boxes[:1], whole.whole_boxes, whole.visible_pixels, whole.contrast
        )
    with pytest.raises(
        ValueError, match=r"^images must be at least one and of one size, got 0 of sizes \[\]$"
    ):
        image_set([])
