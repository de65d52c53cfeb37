"""The part of a study's configuration that a step declares; a step can read nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel

from pipeline.config.schema import Config

Tree = dict[str, "Tree"]


def value_at(plain: Any, key: str) -> Any:
    """The value at a dotted key of plain data, such as `seeds` or `retraining.seeds.0`."""
    for part in key.split("."):
        plain = plain[int(part)] if isinstance(plain, list) else plain[part]
    return plain


def least(keys: Iterable[str]) -> list[str]:
    """The keys, each once, without those inside a section that is also listed."""
    distinct = dict.fromkeys(keys)
    sections = tuple(f"{key}." for key in distinct)
    return [key for key in distinct if not key.startswith(sections)]


def declared(config: Config, keys: Iterable[str]) -> Config:
    """A config with only the values at the dotted keys.

    Reading another key raises AttributeError, or KeyError in a table by name.
    """
    tree: Tree = {}
    for key in least(keys):
        branch = tree
        for part in key.split("."):
            branch = branch.setdefault(part, {})
    only: Config = _part(config, tree)
    return only


def _part(value: Any, tree: Tree) -> Any:
    if not tree:
        return value
    if isinstance(value, BaseModel):
        values = {name: _part(getattr(value, name), branch) for name, branch in tree.items()}
        return type(value).model_construct(**values)
    if isinstance(value, Mapping):
        return {name: _part(value[name], branch) for name, branch in tree.items()}
    return tuple(_part(value[int(index)], branch) for index, branch in tree.items())
