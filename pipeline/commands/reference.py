"""Command `reference`: the pages of docs/reference that the code determines, configuration.md and columns.md."""

from __future__ import annotations

import argparse
import inspect
import sys
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from pipeline.artefacts.tables import TABLES
from pipeline.config.composing import CONF, compose
from pipeline.config.schema import Config
from pipeline.core.columns import Column

HELP = "Write the pages of docs/reference that the code determines."
FOLDER = Path("docs/reference")
GROUPS = {"sampler": "samplers.{}.", "detector": "detector.", "simulator": "simulator."}
"""Folders of conf/ whose files each name a class, and the keys that its parameters have."""
PASSED = ("space", "seed", "model", "scenario", "camera")
"""Parameters that a study's other keys give."""
HEAD = """# Configuration

Made by `python -m pipeline reference` from `pipeline/config/schema.py` and `conf/`. The value is that of `study=default`.

| key | value | range | meaning |
|---|---|---|---|
"""
COLUMNS_HEAD = """# Columns of a campaign's tables

Made by `python -m pipeline reference`. A column's unit is in the Parquet field's metadata, too. Only floats can be without a value.

"""
TABLE_TEXTS = {
    "tests": "A row a test execution. A column for each variable of the scenario follows. A test with status `error` has no KPI: false, 0, "
    "`none` or no value.",
    "signals": "A row a time step, in the world frame. The last row of a test is its end, without a frame. All KPIs follow from it.",
    "frames": "A row for each `campaign.keep_every`-th frame.",
    "timings": "A row a test: wall clock, which no other table has.",
}
CHOICES = """## Strategies, detectors and simulators

Each is a file of `conf/` that names a class, with the values of its parameters. One that the file does not name is set with a plus:
`+samplers.neural.explore=0.3`.
"""


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--check", action="store_true", help="write nothing; exit code 1 if a page is out of date")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder (default: %(default)s)")


def run(options: argparse.Namespace) -> int:
    """Write the pages, or compare them."""
    made = {options.out / name: page() for name, page in PAGES.items()}
    stale = [path for path, text in made.items() if not path.exists() or path.read_text() != text]
    for path in stale:
        if options.check:
            print(f"{path}: out of date; run python -m pipeline reference", file=sys.stderr)
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(made[path])
    return 1 if stale and options.check else 0


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
    from hydra.utils import get_class

    from pipeline.simulators.mujoco.lens import CameraSettings

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


def configuration() -> str:
    """The page of all keys."""
    parts = [line for group, prefix in GROUPS.items() for line in choices(group, prefix)]
    return HEAD + "\n".join([*rows(Config, compose("default", [])), "", CHOICES, *parts])


def columns() -> str:
    """The page of all columns of a campaign's tables."""
    parts = [line for name, table in TABLES.items() for line in (f"## {name}.parquet", "", TABLE_TEXTS[name], "", *described(table), "")]
    return COLUMNS_HEAD + "\n".join(parts)


def described(table: tuple[Column, ...]) -> list[str]:
    """A Markdown table with a row for each column."""
    head = ["| column | type | unit | meaning |", "|---|---|---|---|"]
    return head + [f"| `{c.name}` | {' / '.join(c.allowed) or c.kind.__name__} | {c.unit} | {c.meaning} |" for c in table]


PAGES = {"configuration.md": configuration, "columns.md": columns}
