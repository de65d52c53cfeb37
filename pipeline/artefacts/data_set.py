"""What a data set says of its own images.

These are their names, and conditions that need no further table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import InputError, shown

IMAGE_SETS = "JSON of COCO, BDD100K or OpenLABEL, or a folder of YOLO, KITTI, nuScenes or OpenLABEL"
"""What `image_sets.read_images` reads."""
NOT_APPLICABLE = "not_applicable"
"""The category of an attribute whose parent is absent."""


@dataclass(frozen=True)
class DataSet:
    """The images of a data set.

    Attributes:
        names: of the images or samples, distinct.
        conditions: a text, number or None (unknown) for each image, by condition.
    """

    names: tuple[str, ...]
    conditions: Mapping[str, Sequence[Any]]

    @staticmethod
    def of(path: Path, rows: Sequence[tuple[str, Mapping[str, Any]]]) -> DataSet:
        """The set of named rows, in which a missing condition is unknown.

        Raises:
            InputError: if there is none or a name appears twice.
        """
        if not rows:
            raise InputError(f"{path}: expected images, got none")
        seen: set[str] = set()
        for name, _ in rows:
            if name in seen:
                raise InputError(f"{path}: the image {name} appears twice")
            seen.add(name)
        conditions: dict[str, list[Any]] = {}
        for condition in dict.fromkeys(key for _, values in rows for key in values):
            conditions[condition] = [values.get(condition) for _, values in rows]
        return DataSet(tuple(name for name, _ in rows), conditions)


ARTICLES: Mapping[type, str] = {
    str: "a text",
    list: "a list",
    dict: "a mapping",
    int: "a whole number",
}


def member(path: Path, plain: Any, key: str, kind: type, where: str = "") -> Any:
    """plain[key], which must be of a type.

    Raises:
        InputError: naming the place in the file, what was expected and what came.
    """
    place = f"{where}.{key}" if where else key
    if not isinstance(plain, Mapping) or key not in plain:
        got = f"keys {', '.join(map(str, plain))}" if isinstance(plain, Mapping) else shown(plain)
        raise InputError(f"{path}: {place}: expected {ARTICLES[kind]}, got none, only {got[:200]}")
    if not isinstance(plain[key], kind) or (kind is int and isinstance(plain[key], bool)):
        raise InputError(f"{path}: {place}: expected {ARTICLES[kind]}, got {shown(plain[key])}")
    return plain[key]
