"""The images of data sets.

Their conditions come from the set itself and from a table beside it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

import pyarrow as pa

from pipeline.artefacts.bdd100k import bdd100k, is_bdd100k
from pipeline.artefacts.data_set import DataSet
from pipeline.artefacts.files import read_json
from pipeline.artefacts.kitti import kitti, label_folder
from pipeline.artefacts.nuscenes import is_nuscenes, nuscenes
from pipeline.artefacts.openlabel_tags import is_openlabel, openlabel
from pipeline.artefacts.table_file import Table, read_table
from pipeline.core.space import Space
from pipeline.errors import InputError

IMAGES = (
    ".avif",
    ".bmp",
    ".heic",
    ".jpeg",
    ".jpg",
    ".mpo",
    ".pfm",
    ".png",
    ".tif",
    ".tiff",
    ".webp",
)
NO_LABELS = "classes.txt"
"""Lies beside the labels of a flat folder and names the classes."""
PAIR = ("images", "labels")
KEY = "file_name"
OBJECTS = "objects"


@dataclass(frozen=True)
class Images:
    """The images of a data set and their conditions.

    Attributes:
        table: the conditions of each image, in the order of `names`.
        unused: rows of the metadata that belong to no image.
    """

    table: Table
    names: tuple[str, ...]
    unused: int


def read_images(path: Path, metadata: Path | None, space: Space) -> Images:
    """The conditions of each image of a data set.

    Its format is COCO, YOLO, BDD100K, KITTI, nuScenes, or tags of OpenLABEL.

    Conditions come from `metadata`, a table with a column `file_name`, and from the set itself
    where the table has no such column.

    Raises:
        InputError: naming the file and the image.
    """
    images = _data_set(path, space)
    columns = {}
    for name in space.names:
        if name not in images.conditions:
            continue
        # Whole numbers as such, all else as texts.
        values, kind = images.conditions[name], pa.int64()
        if not all(isinstance(value, int) for value in values):
            values = [None if value is None else str(value) for value in values]
            kind = pa.string()
        columns[name] = pa.chunked_array([pa.array(values, kind)])
    if metadata is None:
        if missing := [name for name in space.names if name not in images.conditions]:
            raise InputError(
                f"{path}: the set itself has no {', '.join(missing)}; name a table of image "
                f"conditions, with a column {KEY}, by --metadata"
            )
        return Images(Table(tuple(images.conditions), columns, len(images.names)), images.names, 0)
    table = read_table(metadata, [KEY, *(name for name in space.names if name != KEY)])
    if KEY not in table.columns:
        raise InputError(f"{metadata}: expected a column {KEY}, got {', '.join(table.header)}")
    matched = _rows(path, images.names, table, metadata)
    rows = pa.array([same[0] for same in matched], pa.int64())
    columns |= {
        name: column.take(rows) for name, column in table.columns.items() if name in space.names
    }
    unused = table.rows - len({row for same in matched for row in same})
    return Images(
        Table((*table.header, *images.conditions), columns, len(rows)), images.names, unused
    )


def _data_set(path: Path, space: Space) -> DataSet:
    if not path.is_dir():
        plain = read_json(path)
        if is_openlabel(plain):
            return openlabel([(path, plain)], space.variables)
        return bdd100k(path, plain) if is_bdd100k(plain) else _coco(path, plain)
    if is_nuscenes(path):
        return nuscenes(path, space.variables)
    if folder := label_folder(path):
        return kitti(folder)
    files = sorted(path.glob("*.json"))
    suffixes = {file.suffix.lower() for file in path.iterdir()}
    flat = suffixes.isdisjoint((*IMAGES, ".txt")) and not any(
        (path / name).exists() for name in PAIR
    )
    if files and flat:
        return openlabel([(file, read_json(file)) for file in files], space.variables)
    return _yolo(path)


def _coco(path: Path, plain: Any) -> DataSet:
    """The images by file name, with the number of annotations of each."""
    names: dict[Any, str] = {}
    counts: dict[str, int] = {}
    try:
        for image in plain["images"]:
            number, name = image["id"], str(image["file_name"])
            if names.get(number, name) != name:
                raise InputError(
                    f"{path}: the image id {number} belongs to {names[number]} and to {name}"
                )
            if number not in names and name in counts:
                raise InputError(f"{path}: the image {name} appears twice, with different ids")
            names[number], counts[name] = name, 0
        for i, annotation in enumerate(plain["annotations"]):
            if annotation["image_id"] not in names:
                raise InputError(
                    f"{path}: annotations[{i}]: expected the id of an image, got "
                    f"{annotation['image_id']!r}"
                )
            counts[names[annotation["image_id"]]] += 1
    except (KeyError, TypeError) as error:
        raise InputError(
            f"{path}: expected COCO's images and annotations, got {error!r}"
        ) from error
    return DataSet(tuple(counts), {OBJECTS: list(counts.values())})


def _yolo(path: Path) -> DataSet:
    """The images by path without suffix, with the number of labelled objects of each.

    An image without a label file has none.
    """
    # In a folder inside `images`, the labels are in the same one inside `labels`.
    base, folders, parts = path, [path], path.resolve().parts
    for place in reversed(range(len(parts))):
        if parts[place] in PAIR:
            both = [Path(*parts[:place], name, *parts[place + 1 :]) for name in PAIR]
            if all(map(Path.is_dir, both)):
                base, folders = Path(*parts[:place]), both
            break
    files = [file for folder in folders for file in sorted(folder.rglob("*")) if file.is_file()]
    images = _apart(base, "images", [file for file in files if file.suffix.lower() in IMAGES])
    labels = _apart(
        base, "labels", [file for file in files if file.suffix == ".txt" and file.name != NO_LABELS]
    )
    if not images and not labels:
        raise InputError(f"{path}: expected a folder of YOLO labels (*.txt) or images, got none")
    named: dict[str, Path] = {}
    for image in images:
        if (other := named.setdefault(_bare(image.relative_to(base)), image)) != image:
            raise InputError(
                f"{path}: {other.name} and {image.name} share one label file, expected one image "
                "for each"
            )
    counts = dict.fromkeys(named, 0)
    counts |= {_bare(label.relative_to(base)): _objects(label) for label in labels}
    return DataSet(tuple(counts), {OBJECTS: list(counts.values())})


def _apart(base: Path, name: str, files: list[Path]) -> list[Path]:
    """The files in folders of this name if there are any, else all."""
    return [file for file in files if name in file.relative_to(base).parts] or files


def _bare(path: str | PurePath) -> str:
    """A path inside a data set as its image and its labels share it.

    It has no suffix and neither `images` nor `labels`.
    """
    inside = PurePath(*(part for part in PurePath(path).parts if part not in PAIR))
    if inside.suffix.lower() in (*IMAGES, ".txt"):
        inside = inside.with_suffix("")
    return inside.as_posix()


def _stem(path: str) -> str:
    return _bare(path).rpartition("/")[2]


def _objects(label: Path) -> int:
    """Number of objects in a label file.

    Raises:
        InputError: for a line that is not a class and at least four numbers.
    """
    count = 0
    for number, line in enumerate(label.read_text(errors="replace").splitlines(), 1):
        if not (fields := line.split()):
            continue
        try:
            numbers = list(map(float, fields))
        except ValueError:
            numbers = []
        if len(numbers) < 5:
            raise InputError(
                f"{label}: line {number}: expected a class and at least four numbers, got "
                f"{line[:80]!r}"
            )
        count += 1
    return count


def _rows(path: Path, images: Sequence[str], table: Table, metadata: Path) -> list[list[int]]:
    """The rows of each image, which agree.

    A row belongs to an image by its path, else without suffix, else by its name alone if no other
    image or row has it.
    """
    keys = table.columns[KEY].cast(pa.string()).to_pylist()
    if None in keys:
        raise InputError(
            f"{metadata}: row {keys.index(None) + 1}: {KEY} must be the name of an image, got "
            "nothing"
        )
    written, bare, alone = _by(str, keys), _by(_bare, keys), _by(_stem, keys)
    stems = Counter(map(_stem, images))
    rows = []
    for image in images:
        matched = written.get(image) or bare.get(_bare(image)) or alone.get(_stem(image), [])
        several = len({_bare(keys[row]) for row in matched}) > 1 or (
            bool(matched) and _bare(image) not in bare and stems[_stem(image)] > 1
        )
        if not matched or several:
            why = f", and several images are called {_stem(image)}" if several else ""
            raise InputError(
                f"{metadata}: expected a row for every image of {path}, there is none for "
                f"{image}{why}"
            )
        for name, column in table.columns.items():
            if (
                name != KEY
                and len(matched) > 1
                and len({column[row].as_py() for row in matched}) > 1
            ):
                raise InputError(
                    f"{metadata}: rows {matched[0] + 1} and {matched[1] + 1} are both {image} and "
                    f"differ in {name}"
                )
        rows.append(matched)
    return rows


def _by(meaning: Callable[[str], str], keys: Sequence[str]) -> dict[str, list[int]]:
    rows: dict[str, list[int]] = {}
    for row, key in enumerate(keys):
        rows.setdefault(meaning(key), []).append(row)
    return rows
