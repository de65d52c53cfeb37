"""YAML with every value as the text that is written, so that `no`, `1.10`, `010` and `12:30` stay
what they are.
"""

from __future__ import annotations

import reprlib
from pathlib import Path
from typing import Any

from pipeline.config.yaml_text import read_yaml
from pipeline.errors import InputError


def read_written_yaml(path: Path) -> Any:
    """Mappings, lists, texts and None (an empty value, `null` or `~`).

    Raises:
        InputError: naming the file and the line.
    """
    try:
        return read_yaml(path, as_written=True)
    except FileNotFoundError as error:
        raise InputError(f"{path}: expected a YAML file, got no such file") from error


def whole_number(key: str, text: Any, low: int, high: int) -> int:
    """The whole number that a text writes; ValueError if it writes none from `low` to `high`."""
    if not isinstance(text, str) or not text.isdecimal() or not low <= int(text) <= high:
        raise ValueError(f"{key}: expected a whole number from {low} to {high}, got {shown(text)}")
    return int(text)


def shown(plain: Any) -> str:
    """A value as YAML, shortened if it is long."""
    if (
        isinstance(plain, list)
        and len(plain) <= 6
        and all(isinstance(item, str | None) for item in plain)
    ):
        return f"[{', '.join(map(shown, plain))}]"
    if plain is None:
        return "null"
    return plain if isinstance(plain, str) and plain else reprlib.repr(plain)
