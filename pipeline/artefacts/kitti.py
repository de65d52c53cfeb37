"""Labels of KITTI's object benchmark (https://www.cvlibs.net/datasets/kitti).

Each image has a text file, each object a line.

A line has a type, truncation (0 to 1), occlusion (0 visible, 1 partly, 2 largely occluded, 3
unknown), an angle, a box, three sizes, a position and a rotation, and in results a score.
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Any

from pipeline.artefacts.data_set import NOT_APPLICABLE, DataSet
from pipeline.errors import InputError

LABELS = "label_2"
FIELDS = (15, 16)
OCCLUSIONS = ("0", "1", "2")
UNKNOWN = "3"
SAMPLED = 50
"""Files that are looked at to tell KITTI's labels from YOLO's: an image may have no object."""


def label_folder(path: Path) -> Path | None:
    """The folder of KITTI's labels.

    It is this one or the `label_2` in it; None if there are other files.
    """
    folder = path / LABELS if (path / LABELS).is_dir() else path
    for file in islice(sorted(folder.glob("*.txt")), SAMPLED):
        for fields in filter(None, map(str.split, file.read_text(errors="replace").splitlines())):
            return folder if len(fields) in FIELDS and fields[0][:1].isalpha() else None
    return folder if folder.name == LABELS else None


def kitti(folder: Path) -> DataSet:
    """Images by the names of their label files.

    Conditions: `objects`, their number without DontCare; `truncation` and `occlusion`, the largest
    of any object, `not_applicable` without objects.

    Raises:
        InputError: naming the file and the line.
    """
    files = sorted(folder.glob("*.txt"))
    return DataSet.of(folder, [(file.stem, _conditions(file)) for file in files])


def _conditions(file: Path) -> dict[str, Any]:
    objects = []
    for number, line in enumerate(file.read_text(errors="replace").splitlines(), 1):
        fields = line.split()
        if fields and len(fields) not in FIELDS:
            raise InputError(
                f"{file}: line {number}: expected {FIELDS[0]} fields, got {len(fields)}: "
                f"{line[:80]!r}"
            )
        if not fields or fields[0] == "DontCare":  # An area without labels.
            continue
        try:
            truncation = float(fields[1])
        except ValueError:
            truncation = -1.0
        if not 0 <= truncation <= 1 or fields[2] not in (*OCCLUSIONS, UNKNOWN):
            raise InputError(
                f"{file}: line {number}: expected a truncation from 0 to 1 and an occlusion from 0 "
                f"to 3, got {fields[1]} and {fields[2]}"
            )
        objects.append((truncation, fields[2]))
    if not objects:
        return {"objects": 0, "truncation": NOT_APPLICABLE, "occlusion": NOT_APPLICABLE}
    levels = {level for _, level in objects}
    unsure = UNKNOWN in levels and OCCLUSIONS[-1] not in levels
    largest = None if unsure else max(level for level in levels if level != UNKNOWN)
    return {
        "objects": len(objects),
        "truncation": repr(max(truncation for truncation, _ in objects)),
        "occlusion": largest,
    }
