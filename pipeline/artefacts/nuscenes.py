"""Tables of nuScenes (https://www.nuscenes.org/nuscenes).

Samples with the location, vehicle and date of their log.
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
    said = {token: _scene(folder, row, logs, variables) for token, row in scenes.items()}
    rows, wanted = [], any(variable.name == "objects" for variable in variables)
    objects = _annotations(folder) if wanted else Counter[str]()
    for token, row in _by_token(folder / "sample.json").items():
        scene = _referred(folder / "sample.json", row, "scene_token", scenes, "scene.json")
        rows.append((token, {**said[scene], **({"objects": objects[token]} if wanted else {})}))
    return DataSet.of(folder / "sample.json", rows)


def _scene(
    folder: Path, row: Mapping[str, Any], logs: Mapping[str, Any], variables: Sequence[Variable]
) -> dict[str, Any]:
    path, where = folder / "scene.json", f"scene {row['token']}"
    log = logs[_referred(path, row, "log_token", logs, "log.json")]
    description = member(path, row, "description", str, where).lower()
    words = {
        variable.name: str(
            bool(re.search(rf"\b{re.escape(variable.name.lower().replace('_', ' '))}", description))
        ).lower()
        for variable in variables
        if set(variable.values) == TRUTH
    }
    of_log = {
        key: member(folder / "log.json", log, key, str, f"log {log['token']}") for key in FROM_LOG
    }
    return {**words, **of_log, "scene": member(path, row, "name", str, where)}


def _annotations(folder: Path) -> Counter[str]:
    """Number of annotations of each sample."""
    path = folder / "sample_annotation.json"
    return Counter(
        member(path, row, "sample_token", str, f"[{index}]")
        for index, row in enumerate(_table(path))
    )


def _table(path: Path) -> list[Any]:
    plain = read_json(path)
    if not isinstance(plain, list):
        raise InputError(f"{path}: expected a list of rows, got {shown(plain)}")
    return plain


def _by_token(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for index, row in enumerate(_table(path)):
        token = member(path, row, "token", str, f"[{index}]")
        if token in found:
            raise InputError(f"{path}: the token {token} appears twice")
        found[token] = row
    return found


def _referred(
    path: Path, row: Mapping[str, Any], key: str, known: Mapping[str, Any], table: str
) -> str:
    token = str(member(path, row, key, str, str(row["token"])))
    if token not in known:
        raise InputError(f"{path}: {row['token']}.{key}: expected a token of {table}, got {token}")
    return token
