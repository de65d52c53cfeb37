"""The one line that says what is wrong in a config: the key, what was expected and what came."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from pipeline.core.names import nearest
from pipeline.errors import shown


def message(error: ValidationError, model: type[BaseModel], prefix: str = "") -> str:
    """The first wrong key of a schema, with the nearest known one if it is unknown. prefix: the key of the section, with a dot."""
    # An unknown key often explains a missing one, so it comes first.
    first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    path = [str(part) for part in first["loc"] if part != "[key]"]
    key, text = prefix + ".".join(path), first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        return f"unknown key '{key}'{nearest(path[-1], _keys(model, path[:-1]))}"
    if first["type"] == "missing":
        return f"key '{key}' is missing"
    # Our own errors say what came.
    got = "" if first["type"] == "value_error" or isinstance(first["input"], dict) else f", got {shown(first['input'])}"
    return f"{key}: {text}{got}" if key else text + got


def _keys(model: Any, path: Sequence[str]) -> list[str]:
    """Known keys of the section at a path of the schema."""
    for part in path:
        fields = getattr(model, "model_fields", {})
        if part in fields:
            model = fields[part].annotation
        if get_args(model):
            model = next((a for a in get_args(model) if isinstance(a, type) and issubclass(a, BaseModel)), model)
    return list(getattr(model, "model_fields", {}))
