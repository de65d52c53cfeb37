"""Writes docs/reference/configuration.md from the schema, or with --check compares them.

python docs/generate.py [--check]
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from pipeline.config import Config, compose

PATH = Path(__file__).parent / "reference" / "configuration.md"
HEAD = """# Configuration

Made by `python docs/generate.py` from `pipeline/config.py` and `conf/`. The value is that of `study=default`.

| key | value | range | meaning |
|---|---|---|---|
"""


def rows(model: type[BaseModel], values: Any, prefix: str = "") -> list[str]:
    """A table row for each key of a section and of the sections in it."""
    lines = []
    for name, field in model.model_fields.items():
        value, key = getattr(values, name), f"{prefix}{name}"
        if isinstance(value, BaseModel):
            lines += rows(type(value), value, f"{key}.")
            continue
        shown = ", ".join(map(str, value)) if isinstance(value, dict | tuple) else str(value)
        text = (field.description or "").replace("\n", " ")
        lines.append(f"| `{key}` | {shown} | {limits(field.metadata)} | {text} |")
    return lines


def limits(metadata: list[Any]) -> str:
    """The range of a value, from pydantic's constraints."""
    signs = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
    return ", ".join(f"{sign} {getattr(m, key):g}" for m in metadata for key, sign in signs.items() if getattr(m, key, None) is not None)


def main() -> int:
    """Write or check the page."""
    text = HEAD + "\n".join(rows(Config, compose("default", []))) + "\n"
    if "--check" in sys.argv:
        if not PATH.exists() or PATH.read_text() != text:
            print(f"{PATH}: out of date; run python docs/generate.py", file=sys.stderr)
            return 1
        return 0
    PATH.parent.mkdir(parents=True, exist_ok=True)
    PATH.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
