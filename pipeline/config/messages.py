"""The message for a wrong config, on one line: the key, the expected and the actual value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from pipeline.core.names import nearest
from pipeline.errors import shown

EXPECTED = {
    "int_type": "a whole number",
    "float_type": "a number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list in square brackets",
    "tuple_type": "a list in square brackets",
    "dict_type": "keys with values",
    "model_type": "keys with values",
    "too_short": "at least {min_length}",
    "too_long": "at most {max_length}",
    "greater_than": "more than {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than_equal": "at most {le}",
}
"""What Pydantic's errors mean, in the words of those who write YAML. {name}: a limit from the
error's context."""
LIMITS = ("min_length", "max_length", "gt", "ge", "le")


def message(error: ValidationError, model: type[BaseModel], prefix: str = "") -> str:
    """The message for the first wrong key of a schema.

    prefix: the key of the section, with a dot. An unknown key gets the nearest possible one.
    """
    # An unknown key often explains a missing one, so it comes first.
    first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    path = [str(part) for part in first["loc"] if part != "[key]"]
    key, text = prefix + ".".join(path), _text(first)
    if first["type"] == "extra_forbidden":
        return f"unknown key '{key}'{nearest(path[-1], _keys(model, path[:-1]))}"
    if first["type"] == "missing":
        return f"key '{key}' is missing"
    # Our own errors say what came.
    silent = first["type"] == "value_error" or (isinstance(first["input"], dict) and first["input"])
    got = "" if silent else f", got {shown(first['input'])}"
    return f"{key}: {text}{got}" if key else text + got


def _text(error: ErrorDetails) -> str:
    if error["type"] in EXPECTED:
        limits = {
            name: int(value) if value == int(value) else value
            for name, value in error.get("ctx", {}).items()
            if name in LIMITS
        }
        return "expected " + EXPECTED[error["type"]].format(**limits)
    return error["msg"].removeprefix("Value error, ").replace("Input should be", "expected", 1)


def _keys(model: Any, path: Sequence[str]) -> list[str]:
    """The possible keys of the section at a path of the schema."""
    for part in path:
        fields = getattr(model, "model_fields", {})
        if part in fields:
            model = fields[part].annotation
        if get_args(model):
            classes = [part for part in get_args(model) if isinstance(part, type)]
            model = next((part for part in classes if issubclass(part, BaseModel)), model)
    return list(getattr(model, "model_fields", {}))
