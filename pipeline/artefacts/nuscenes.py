"""Tables of nuScenes (https://www.nuscenes.org/nuscenes).

They give samples with the location, vehicle and date of their log.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.artefacts.data_set import DataSet, member
from pipeline.artefacts.files import read_json
from pipeline.core.space import Variable
from pipeline.errors import InputError, shown

TABLES = ("log", "scene", "sample")
FROM_LOG = ("location", "vehicle", "date_captured")
TRUTH = {"true", "false"}


def is_nuscenes(folder: Path) -> bool:
    """Whether a folder has the tables."""
    return all((folder / f"{name}.json").is_file() for name in TABLES)


def nuscenes(folder: Path, variables: Sequence[Variable]) -> DataSet:
    """Samples by their tokens.

    Conditions: `location`, `vehicle` and `date_captured` of the log; `scene`, its name; `objects`,
    the number of annotations, if a variable asks for it. A variable with the values true and false
    is true where a word of the scene's description begins with its name, such as rain or night.

    Raises:
        InputError: naming the table and the row.
    """
    logs, scenes = (_by_token(folder / f"{name}.json") for name in ("log", "scene"))
    path = folder / "scene.json"
    of_scene: dict[str, dict[str, Any]] = {}
    for token, row in scenes.items():
        log = logs[_referred(path, row, "log_token", logs, "log.json")]
        description = member(path, row, "description", str, f"scene {token}").lower()
        conditions: dict[str, Any] = {}
        for variable in variables:
            if set(variable.values) == TRUTH:
                word = re.escape(variable.name.lower().replace("_", " "))
                conditions[variable.name] = str(bool(re.search(rf"\b{word}", description))).lower()
        for key in FROM_LOG:
            conditions[key] = member(folder / "log.json", log, key, str, f"log {log['token']}")
        conditions["scene"] = member(path, row, "name", str, f"scene {token}")
        of_scene[token] = conditions
    samples = folder / "sample.json"
    points: dict[str, dict[str, Any]] = {}
    for token, row in _by_token(samples).items():
        points[token] = dict(of_scene[_referred(samples, row, "scene_token", scenes, "scene.json")])
    if any(variable.name == "objects" for variable in variables):
        path, objects = folder / "sample_annotation.json", Counter[str]()
        for index, row in enumerate(_table(path)):
            objects[member(path, row, "sample_token", str, f"[{index}]")] += 1
        for token, conditions in points.items():
            conditions["objects"] = objects[token]
    return DataSet.of(samples, list(points.items()))


def _table(path: Path) -> list[Any]:
    plain = read_json(path)
    if not isinstance(plain, list):
        raise InputError(f"{path}: expected a list of rows, got {shown(plain)}")
    return plain


def _by_token(path: Path) -> dict[str, Any]:
    rows: dict[str, Any] = {}
    for index, row in enumerate(_table(path)):
        token = member(path, row, "token", str, f"[{index}]")
        if token in rows:
            raise InputError(f"{path}: the token {token} appears twice")
        rows[token] = row
    return rows


def _referred(
    path: Path, row: Mapping[str, Any], key: str, rows: Mapping[str, Any], table: str
) -> str:
    token = str(member(path, row, key, str, str(row["token"])))
    if token not in rows:
        raise InputError(f"{path}: {row['token']}.{key}: expected a token of {table}, got {token}")
    return token
