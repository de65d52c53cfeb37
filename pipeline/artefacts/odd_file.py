"""OpenODD files (ASAM OpenODD 1.0 in YAML), such as a taxonomy of ISO 34503 and the modules of an
ODD, as spaces.

Beside the standard's IMPORT, TAXONOMY, MODULES and ODD, a file may have COVERAGE with what coverage
needs to know and OpenODD does not say: CONCEPTS to count, CUTS of numbers, what is OPTIONAL and
what APPLIES_IF something else holds.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.artefacts.odd_space import odd_space
from pipeline.artefacts.written_yaml import read_written_yaml
from pipeline.core.names import nearest
from pipeline.core.space import Space
from pipeline.errors import InputError, shown

KEYS = ("IMPORT", "TAXONOMY", "MODULES", "MODULE", "ODD", "COVERAGE")
BEGINS = re.compile(rb"^(%s)[ \t]*:" % "|".join(KEYS).encode(), re.MULTILINE)
"""A line that only OpenODD files have."""


def read_odd_file(path: Path) -> Space:
    """Read an OpenODD file and what it imports.

    Raises:
        InputError: naming the file and the place: for what is wrong, and for what a space cannot
            say.
    """
    parts: dict[str, dict[str, Any]] = {"TAXONOMY": {}, "MODULES": {}, "ODD": {}, "COVERAGE": {}}
    _read(path, parts, [])
    try:
        return odd_space(parts)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
    except RecursionError as error:
        raise InputError(f"{path}: the YAML is nested too deeply") from error


def _read(path: Path, parts: dict[str, dict[str, Any]], read: list[Path]) -> None:
    """Add the sections of a file, after those of its imports."""
    if path.resolve() in read:
        return
    read.append(path.resolve())
    plain = read_written_yaml(path)
    if not isinstance(plain, dict):
        raise InputError(f"{path}: expected a mapping with {', '.join(KEYS)}")
    for key in plain:
        if key not in KEYS:
            raise InputError(f"{path}: {key} is not read{nearest(str(key), KEYS)}")
    imports = plain.get("IMPORT") or []
    if not isinstance(imports, list) or not all(isinstance(name, str) for name in imports):
        raise InputError(f"{path}: IMPORT: expected a list of files, got {shown(imports)}")
    for name in imports:
        _read(path.parent / name, parts, read)
    for key in KEYS[1:]:
        if (section := plain.get(key)) is None:
            continue
        if not isinstance(section, dict):
            raise InputError(f"{path}: {key}: expected a mapping, got {shown(section)}")
        _merge(path, key, parts["MODULES" if key == "MODULE" else key], section)


def _merge(path: Path, where: str, whole: dict[str, Any], part: Mapping[str, Any]) -> None:
    for key, value in part.items():
        place = f"{where}.{key}"
        if key not in whole:
            whole[key] = value
        elif (
            where.startswith("TAXONOMY")
            and isinstance(whole[key], dict)
            and isinstance(value, dict)
        ):
            _merge(path, place, whole[key], value)
        else:
            raise InputError(f"{path}: {place}: an imported file has this, too")
