"""What `_target_` names in conf/."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from pipeline.errors import InputError, shown


def named(key: str, target: str) -> Any:
    """The object of a dotted name; InputError that names the key if there is none."""
    module, _, name = target.rpartition(".")
    try:
        return getattr(import_module(module), name)
    except InputError:
        raise
    except Exception as error:  # A foreign module may raise anything.
        raise InputError(f"{key}: there is no {shown(target)} ({error})") from error
