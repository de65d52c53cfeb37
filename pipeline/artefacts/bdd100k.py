"""Labels of BDD100K (https://doc.bdd100k.com).

They give weather, scene and timeofday of each image, and its boxes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.artefacts.data_set import DataSet, member
from pipeline.errors import InputError, shown


def is_bdd100k(plain: Any) -> bool:
    """Whether JSON is a list of labelled frames, the same inside `frames`, or the file of one
    image.
    """
    frames = plain.get("frames") if isinstance(plain, dict) else plain
    return (
        isinstance(frames, list)
        and (not frames or isinstance(frames[0], dict))
        and not (isinstance(plain, dict) and "images" in plain)
    )


def bdd100k(path: Path, plain: Any) -> DataSet:
    """Images of a label file; `undefined` is no category of a space, so the image is partial.

    Conditions: the `attributes` of the image, and `objects`, its number of labels with a box.

    Raises:
        InputError: naming the place.
    """
    if isinstance(plain, dict) and "name" in plain:
        return DataSet.of(path, [_image(path, "", plain)])
    frames = plain["frames"] if isinstance(plain, dict) else plain
    return DataSet.of(
        path, [_image(path, f"[{index}]", frame) for index, frame in enumerate(frames)]
    )


def _image(path: Path, where: str, frame: Any) -> tuple[str, dict[str, Any]]:
    name = member(path, frame, "name", str, where)
    conditions: dict[str, Any] = {}
    attributes = {}
    if frame.get("attributes") is not None:
        attributes = member(path, frame, "attributes", dict, where)
    for key, value in attributes.items():
        if not isinstance(value, str | int | float | None):
            raise InputError(
                f"{path}: {where}.attributes.{key}: expected a text, got {shown(value)}"
            )
        conditions[key] = None if value is None else str(value)
    conditions["objects"] = 0
    # An image's own file has the `objects` of its only frame, the others have `labels`.
    labels: list[Any] = []
    if isinstance(frame.get("frames"), list):
        for inner in frame["frames"]:
            labels += member(path, inner, "objects", list, f"{where}.frames")
    elif frame.get("labels") is not None:
        labels = member(path, frame, "labels", list, where)
    for label in labels:
        if not isinstance(label, dict):
            raise InputError(f"{path}: {where}.labels: expected mappings, got {shown(label)}")
        conditions["objects"] += label.get("box2d") is not None
    return name, conditions
