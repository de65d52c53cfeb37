"""YAML with every value as the text that is written, so that `no`, `1.10`, `010` and `12:30` stay what they are."""

from __future__ import annotations

import reprlib
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

from pipeline.errors import InputError

READ_AS_TEXT = ("bool", "int", "float", "timestamp", "value", "merge")
"""The types that YAML 1.1 would make of unquoted text."""


def read_written_yaml(path: Path) -> Any:
    """Mappings, lists, texts and None (an empty value, `null` or `~`).

    Raises InputError that names the file: if it is unreadable, not YAML, nested too deeply, or has a key twice in one mapping.
    """
    try:
        return yaml.load(path.read_bytes(), Loader=_AsWritten)
    except OSError as error:
        raise InputError(f"{path}: expected a YAML file, got {error.strerror}") from error
    except RecursionError as error:
        raise InputError(f"{path}: the YAML is nested too deeply") from error
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"{path}: not valid YAML ({_first_line(error)})") from error


def _first_line(error: Exception) -> str:
    mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
    return f"line {mark.line + 1}: {problem}" if mark and problem else str(error).splitlines()[0]


def whole_number(key: str, text: Any, low: int, high: int) -> int:
    """The whole number that a text writes; ValueError if it writes none from `low` to `high`."""
    if not isinstance(text, str) or not text.isdecimal() or not low <= int(text) <= high:
        raise ValueError(f"{key}: expected a whole number from {low} to {high}, got {shown(text)}")
    return int(text)


def shown(plain: Any) -> str:
    """A value as YAML, shortened if it is long."""
    if isinstance(plain, list) and len(plain) <= 6 and all(isinstance(item, str | None) for item in plain):
        return f"[{', '.join(map(shown, plain))}]"
    return "null" if plain is None else plain if isinstance(plain, str) and plain else reprlib.repr(plain)


class _AsWritten(yaml.SafeLoader):  # type: ignore[misc]
    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        if isinstance(node, yaml.MappingNode):
            seen: set[str] = set()
            for key, _ in node.value:
                if isinstance(key, yaml.ScalarNode):
                    if key.value in seen:
                        raise yaml.MarkedYAMLError(problem=f"the key '{key.value}' appears twice", problem_mark=key.start_mark)
                    seen.add(key.value)
        return dict(super().construct_mapping(node, deep))


for _type in READ_AS_TEXT:
    _AsWritten.add_constructor(f"tag:yaml.org,2002:{_type}", yaml.SafeLoader.construct_scalar)
