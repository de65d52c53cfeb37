"""Writes docs/reference/configuration.md from the schema, or with --check compares them.

python docs/generate.py [--check]
"""

from __future__ import annotations

import inspect
import sys
from pathlib import Path
from typing import Any

import yaml
from hydra.utils import get_class
from pydantic import BaseModel

from pipeline.config.composing import compose
from pipeline.config.schema import Config
from pipeline.simulators.mujoco.lens import CameraSettings

PATH = Path(__file__).parent / "reference" / "configuration.md"
CONF = Path(__file__).parents[1] / "conf"
GROUPS = {"sampler": "samplers.{}.", "detector": "detector.", "simulator": "simulator."}
"""Folders of conf/ whose files each name a class, and the keys that its parameters have."""
PASSED = ("space", "seed", "constraints", "model", "scenario", "camera")
"""Parameters that a study's other keys give."""
HEAD = """# Configuration

Made by `python docs/generate.py` from `pipeline/config.py` and `conf/`. The value is that of `study=default`.

| key | value | range | meaning |
|---|---|---|---|
"""


CHOICES = """## Strategies, detectors and simulators

Each is a file of `conf/` that names a class, with the values of its parameters. One that the file does not name is set with a plus:
`+samplers.neural.explore=0.3`.
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


def choices(group: str, prefix: str) -> list[str]:
    """A section for each file of a folder of conf/: what its class says of itself, and its parameters with their values."""
    lines = []
    for path in sorted((CONF / group).glob("*.yaml")):
        body = yaml.safe_load(path.read_text())
        described = get_class(body["_target_"])
        lines += [f"### {group}: {path.stem}", "", inspect.getdoc(described) or "", ""]
        taken = [p for p in inspect.signature(described).parameters.values() if p.name not in PASSED]
        parts = [f"`{prefix.format(path.stem)}{p.name}` {body.get(p.name, p.default)}" for p in taken]
        if "camera" in body:
            parts += [
                f"`{prefix}camera.{name}` {value} {limits(CameraSettings.model_fields[name].metadata)}".rstrip()
                for name, value in body["camera"].items()
            ]
            lines += [inspect.getdoc(CameraSettings) or "", ""]
        lines += ["; ".join(parts) + "." if parts else "No parameters.", ""]
    return lines


def limits(metadata: list[Any]) -> str:
    """The range of a value, from pydantic's constraints."""
    signs = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
    return ", ".join(f"{sign} {getattr(m, key):g}" for m in metadata for key, sign in signs.items() if getattr(m, key, None) is not None)


def main() -> int:
    """Write or check the page."""
    parts = [line for group, prefix in GROUPS.items() for line in choices(group, prefix)]
    text = HEAD + "\n".join([*rows(Config, compose("default", [])), "", CHOICES, *parts])
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
