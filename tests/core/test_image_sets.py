"""Images of COCO and YOLO data sets as points.

Backgrounds, layouts, and names that two images or rows share.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pipeline.artefacts.point_table import read_points
from pipeline.artefacts.space_file import read_space_file
from pipeline.core.space import Space
from pipeline.errors import InputError

LABEL = "0 0.5 0.5 0.1 0.1\n"
META = "file_name,weather\na.jpg,sunny\nb.jpg,rainy\nc.jpg,rainy\n"


@pytest.fixture
def space(tmp_path: Path) -> Space:
    path = tmp_path / "space.yaml"
    path.write_text(
        "variables: {weather: {values: [sunny, rainy]}, objects: {interval: [0, 9], cuts: [1, 3]}}"
    )
    return read_space_file(path)


def points(folder: Path, space: Space, points: str, metadata: str = META) -> list[list[int]]:
    (folder / "meta.csv").write_text(metadata)
    found: list[list[int]] = (
        read_points(folder / points, space, metadata=folder / "meta.csv").strict().tolist()
    )
    return found


def lay(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


EXPECTED = [[0, 2], [1, 0], [1, 1]]
LAYOUTS = {
    "apart": {
        "images/a.jpg": "",
        "images/b.jpg": "",
        "images/c.PNG": "",
        "labels/a.txt": LABEL * 3,
        "labels/c.txt": LABEL,
        "train.txt": "images/a.jpg",
    },
    "splits": {
        "images/train/a.jpg": "",
        "images/val/b.jpg": "",
        "images/val/c.jpg": "",
        "labels/train/a.txt": LABEL * 3,
        "labels/val/c.txt": LABEL,
    },
    "splits first": {
        "train/images/a.jpg": "",
        "val/images/b.jpg": "",
        "val/images/c.jpg": "",
        "train/labels/a.txt": LABEL * 3,
        "val/labels/c.txt": LABEL,
        "README.txt": "read me",
    },
    "flat": {
        "a.jpg": "",
        "b.jpg": "",
        "c.jpg": "",
        "a.txt": LABEL * 3,
        "c.txt": LABEL,
        "classes.txt": "person\n",
    },
    "only labels": {"a.txt": LABEL * 3, "b.txt": "\n", "c.txt": LABEL, "classes.txt": "person\n"},
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_images_without_labels_are_backgrounds_in_every_layout(
    layout: str, space: Space, tmp_path: Path
) -> None:
    lay(tmp_path / "set", LAYOUTS[layout])
    assert points(tmp_path, space, "set") == EXPECTED


@pytest.mark.parametrize("named", ["images", "labels"])
def test_either_folder_of_images_and_labels_names_both(
    named: str, space: Space, tmp_path: Path
) -> None:
    lay(tmp_path / "set", LAYOUTS["apart"])
    assert points(tmp_path, space, f"set/{named}") == EXPECTED


def test_names_with_points_are_whole_names(space: Space, tmp_path: Path) -> None:
    lay(tmp_path / "set", {"scene.1.txt": LABEL, "scene.2.txt": ""})
    assert points(
        tmp_path, space, "set", "file_name,weather\nscene.1.jpg,sunny\nscene.2,rainy\n"
    ) == [[0, 1], [1, 0]]


def test_a_row_twice_must_agree(space: Space, tmp_path: Path) -> None:
    lay(tmp_path / "set", LAYOUTS["apart"])
    assert points(tmp_path, space, "set", META + "a.jpg,sunny\n") == EXPECTED
    with pytest.raises(
        InputError, match=r"meta.csv: rows 1 and 4 are both a and differ in weather"
    ):
        points(tmp_path, space, "set", META + "a.jpg,rainy\n")
    with pytest.raises(
        InputError, match=r"row 4: file_name must be the name of an image, got nothing"
    ):
        points(tmp_path, space, "set", META + ",rainy\n")
    with pytest.raises(
        InputError, match=r"meta.csv: expected a column file_name, got name, weather"
    ):
        points(tmp_path, space, "set", "name,weather\na,sunny\n")
    with pytest.raises(
        InputError, match=r"meta.csv: expected a column file_name, got filename, Weather"
    ):
        points(tmp_path, space, "set", "filename,Weather\na,sunny\n")
    with pytest.raises(
        InputError,
        match=r"meta.csv: expected a column for each condition; there is none for weather",
    ):
        points(tmp_path, space, "set", META.replace("weather", "wether"))


def test_rows_without_an_image_are_counted(space: Space, tmp_path: Path) -> None:
    lay(tmp_path / "set", LAYOUTS["apart"])
    (tmp_path / "meta.csv").write_text(META + "a.jpg,sunny\nd.jpg,sunny\ne.jpg,rainy\n")
    table = read_points(tmp_path / "set", space, metadata=tmp_path / "meta.csv")
    assert table.unused == 2 and table.images == ("a", "b", "c")


def test_two_images_with_one_label_file_are_refused(space: Space, tmp_path: Path) -> None:
    lay(tmp_path / "set", {"a.jpg": "", "a.png": ""})
    with pytest.raises(InputError, match=r"a.jpg and a.png share one label file"):
        points(tmp_path, space, "set")


@pytest.mark.parametrize("text", ["person 1 2 3 4\n", "0 0.5 0.5 0.1\n", "notes\n"])
def test_a_file_that_is_no_label_file_is_named(text: str, space: Space, tmp_path: Path) -> None:
    lay(tmp_path / "set", {"a.txt": LABEL + text})
    with pytest.raises(
        InputError, match=r"a.txt: line 2: expected a class and at least four numbers, got"
    ):
        points(tmp_path, space, "set")


@pytest.mark.parametrize(
    ("images", "image", "message"),
    [
        ([(1, "a.jpg"), (1, "b.jpg")], 1, "the image id 1 belongs to a.jpg and to b.jpg"),
        ([(1, "a.jpg"), (2, "a.jpg")], 1, "the image a.jpg appears twice, with different ids"),
        ([(1, "a.jpg")], 7, r"annotations\[0\]: expected the id of an image, got 7"),
        (
            [(1, "d.jpg")],
            1,
            "expected a row for every image of .*truth.json, there is none for d.jpg",
        ),
    ],
)
def test_coco_files_that_contradict_themselves_are_refused(
    images: list[tuple[int, str]], image: int, message: str, space: Space, tmp_path: Path
) -> None:
    plain = {
        "images": [{"id": i, "file_name": name} for i, name in images],
        "annotations": [{"id": 1, "image_id": image}],
    }
    (tmp_path / "truth.json").write_text(json.dumps(plain))
    with pytest.raises(InputError, match=message):
        points(tmp_path, space, "truth.json")


def test_coco_tells_images_apart_by_their_suffix(space: Space, tmp_path: Path) -> None:
    plain = {
        "images": [{"id": 1, "file_name": "a.jpg"}, {"id": 2, "file_name": "a.png"}],
        "annotations": [],
    }
    (tmp_path / "truth.json").write_text(json.dumps(plain))
    assert points(
        tmp_path, space, "truth.json", "file_name,weather\na.png,rainy\na.jpg,sunny\n"
    ) == [[0, 0], [1, 0]]
