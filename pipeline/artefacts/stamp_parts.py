"""What a stamp stands for, part by part, so that the reason of a job can name the key or the file
that changed.

It is a cache: without it, the reason is less exact, and nothing else changes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from pipeline.artefacts.files import write_bytes
from pipeline.errors import InputError

PARTS = Path(".cache/stamps")
MARKS = "changed"
"""The input of a job that stands for its reasons: it only makes Snakemake run the job again, and no
step reads it."""


def remember(digest: str, parts: Mapping[str, str]) -> None:
    """Store the parts of a digest.

    Each has a name and its own digest, which may have parts itself.
    """
    path = PARTS / f"{digest}.json"
    if not path.exists():
        with suppress(OSError, InputError):
            write_bytes(path, json.dumps(parts).encode(), flush=False)


@lru_cache(maxsize=4096)
def differences(old: str, new: str) -> tuple[str, ...]:
    """Names of the smallest parts in which two digests differ.

    There are none if the parts of either are unknown.
    """
    before, after = _parts(old), _parts(new)
    if not before or not after:
        return ()
    names: dict[str, None] = {}
    for name in (*after, *(name for name in before if name not in after)):
        if before.get(name) != after.get(name):
            deeper = differences(before.get(name, ""), after.get(name, "")) or (name,)
            names |= dict.fromkeys(deeper)
    return tuple(names)


def _parts(digest: str) -> dict[str, str]:
    try:
        return dict(json.loads((PARTS / f"{digest}.json").read_bytes())) if digest else {}
    except (OSError, ValueError):
        return {}
