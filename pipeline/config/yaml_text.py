"""Reads YAML strictly: UTF-8, each key once, no aliases, which can expand without end."""

from __future__ import annotations

import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any, ClassVar

import yaml

from pipeline.errors import InputError, shown

NULL = ("tag:yaml.org,2002:null", re.compile(r"(~|null|Null|NULL|)\Z"))


def _wrong(problem: str, place: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=place.start_mark)


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()
            raise _wrong(f"the alias *{event.anchor} is not allowed: write out the value", event)
        node: yaml.Node | None = super().compose_node(parent, index)
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen = set()
        for key, _ in node.value:
            if key.tag != "tag:yaml.org,2002:str":
                raise _wrong(f"expected text as a key, got {shown(key.value)}", key)
            if key.value in seen:
                raise _wrong(f"the key {shown(key.value)} appears twice", key)
            seen.add(key.value)
        mapping: dict[Hashable, Any] = super().construct_mapping(node, deep)
        return mapping


class _AsWritten(_Loader):
    """Takes unquoted text for the text that is written, but for `null`, `~` and nothing."""

    yaml_implicit_resolvers: ClassVar = {start: [NULL] for start in ("~", "n", "N", "")}


def read_yaml(path: Path, *, as_written: bool = False) -> Any:
    """The plain data of a file.

    Args:
        path: of the file.
        as_written: whether `no`, `1.10`, `010` and `12:30` stay the texts that are written; only
            None is no text then.

    Raises:
        FileNotFoundError: no such file.
        InputError: no valid YAML; the message names the file and the line.
    """
    try:
        return yaml.load(path.read_text(encoding="utf-8"), _AsWritten if as_written else _Loader)
    except FileNotFoundError:
        raise
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: expected UTF-8 text, "
            f"got the byte 0x{error.object[error.start]:02x} at {error.start}"
        ) from error
    except OSError as error:
        raise InputError(f"{path}: expected a readable file, got {error.strerror}") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        line = f", line {mark.line + 1}" if mark else ""
        raise InputError(f"{path}{line}: not valid YAML ({problem})") from error
    except RecursionError as error:
        raise InputError(f"{path}: nested too deeply") from error
    except ValueError as error:  # A number or a date that Python rejects.
        raise InputError(f"{path}: not valid YAML ({error})") from error
