"""Write the files of docs/reference that the code determines, or check them.

They are configuration.md, columns.md and evidence.schema.json.

Usage: python tools/reference.py [--check] [--out FOLDER]
"""

from __future__ import annotations

import argparse
import inspect
import json
import re
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from hydra.utils import get_class
from pydantic import BaseModel

from pipeline.artefacts.evidence import Evidence
from pipeline.artefacts.files import write_bytes
from pipeline.artefacts.tables import TABLES, WHY
from pipeline.config.composing import CONF, compose
from pipeline.config.schema import Config
from pipeline.core.columns import Column
from pipeline.errors import InputError
from pipeline.simulators.mujoco.lens import CameraSettings

FOLDER = Path("docs/reference")
GROUPS = {"sampler": "samplers.{}.", "detector": "detector.", "simulator": "simulator."}
"""Folders of conf/ with a class per file, and the keys that hold its parameters."""
PASSED = ("space", "seed", "model", "scenario", "camera", "vehicle")
"""Parameters set by other keys of a study."""
HEAD = """# Configuration

Made by `python tools/reference.py` from `pipeline/config/` and `conf/`. Each line gives a key, its
value in `study=default`, its range in brackets and its meaning.
"""
COLUMNS_HEAD = """# Columns of the tables of campaigns and regions

Made by `python tools/reference.py`. The metadata of each Parquet field holds the unit, too. Only
floats can have no value.

"""
TABLE_TEXTS = {
    "tests": "One row for each test. A column for each variable of the scenario follows. A test "
    "with status `error` has no KPIs: they are false, 0, `none` or have no value.",
    "signals": "One row for each time step, in the world frame. The last row of a test is its end, "
    "without a frame. All KPIs are computed from these columns.",
    "detections": "One row for each detection in each frame, best first, so that matching and "
    "braking can be computed again.",
    "frames": "One row for every n-th frame; n is `campaign.keep_every`.",
    "timings": "One row for each test, with wall-clock times. No other table has any.",
}
WHY_TEXT = """One row for each failure of a region as its campaign executed it, and one for each
rerun with a single change; see [regions](../howto/regions.md). Distances are from the ego's front
to the conflict point."""
CHOICES = """## Strategies, detectors, simulators and cameras

Each is a file in `conf/`; all but cameras name a class and set its parameters. To set a parameter
that the file does not name, put a plus before it: `+samplers.forest.explore=0.3`.
"""
LINE = 120
SECTION = re.compile(r"\n+(?:(?:Args|Attributes|Raises):|>>> )")
ARGUMENTS = re.compile(r"^(?:Args|Attributes):\n((?: {4}.*\n?)+)", re.MULTILINE)
ARGUMENT = re.compile(r"^ {4}(\w[\w, ]*): (.*\n?(?: {8}.*\n?)*)", re.MULTILINE)


def main(words: Sequence[str] | None = None) -> int:
    """Write the pages, or compare them; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument(
        "--check", action="store_true", help="write nothing; exit code 1 if a page is out of date"
    )
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder (default: %(default)s)")
    options = parser.parse_args(words)
    stale = False
    for name, page in PAGES.items():
        path, text = options.out / name, page()
        if path.exists() and path.read_text() == text:
            continue
        if options.check:
            stale = True
            print(f"{path}: out of date; run python tools/reference.py", file=sys.stderr)
            continue
        try:
            write_bytes(path, text.encode())
        except InputError as error:
            print(error, file=sys.stderr)
            return 2
    return 1 if stale else 0


def section(model: type[BaseModel], values: Any, prefix: str = "") -> list[str]:
    """The keys of a section as a list, then each section in it under its heading."""
    keys: list[str] = []
    below: list[str] = []
    for name, field in model.model_fields.items():
        value, key = getattr(values, name), f"{prefix}{name}"
        if isinstance(value, BaseModel):
            text = wrapped(inspect.getdoc(type(value)) or "")
            below += [f"## {key}", "", *text, "", *section(type(value), value, f"{key}.")]
        else:
            keys += item(key, value, limits(field.metadata), field.description or "")
    return [*keys, "", *below]


def choices(group: str, prefix: str) -> list[str]:
    """A section for each file of a folder of conf/: its class's docstring, parameters, values."""
    lines = []
    sections: dict[type, str] = {}
    for path in sorted((CONF / group).glob("[!_]*.yaml")):
        body = yaml.safe_load(path.read_text())
        described = get_class(body["_target_"])
        text, meanings = documented(described)
        first = sections.setdefault(described, path.stem)
        if first != path.stem:
            text, meanings = f"As `{first}`, with other values.", {}
        keys: list[str] = []
        for name, parameter in inspect.signature(described).parameters.items():
            if name not in PASSED:
                value = body.get(name, parameter.default)
                keys += item(f"{prefix.format(path.stem)}{name}", value, "", meanings.get(name, ""))
        lines += [f"### {group}: {path.stem}", "", text, ""]
        lines += [*(keys or ["No parameters."]), ""]
    return lines


def documented(described: type) -> tuple[str, dict[str, str]]:
    """The docstring of a class without its sections, and the meaning of each argument.

    Arguments that the class inherits have the meaning that a base class gives.
    """
    meanings: dict[str, str] = {}
    for base in reversed(described.__mro__):
        section_of_arguments = ARGUMENTS.search(inspect.cleandoc(vars(base).get("__doc__") or ""))
        for names, meaning in ARGUMENT.findall(
            section_of_arguments[1] if section_of_arguments else ""
        ):
            for name in names.split(", "):
                if name not in meanings or not meaning.startswith("as for"):
                    meanings[name] = meaning
    return SECTION.split(inspect.getdoc(described) or "")[0], meanings


def cameras() -> list[str]:
    """A section for each file of conf/camera with the settings that it names."""
    lines = []
    for number, path in enumerate(sorted((CONF / "camera").glob("*.yaml"))):
        settings = yaml.safe_load(path.read_text())
        parent = settings.pop("defaults", [None])[0]
        lines += [f"### camera: {path.stem}", ""]
        text, meanings = documented(CameraSettings)
        if number == 0:
            lines += [text, ""]
        for name, value in settings.items():
            range_text = limits(CameraSettings.model_fields[name].metadata)
            meaning = "" if number else meanings.get(name, "")
            lines += item(f"simulator.camera.{name}", value, range_text, meaning)
        lines.append("")
        if parent:
            lines += [f"The rest is as in {parent}.", ""]
    return lines


def item(key: str, value: Any, limits: str = "", meaning: str = "") -> list[str]:
    """The lines of a list's item on one key."""
    parts = [
        f"- `{key}`: {shown(value)}",
        f"({limits})" if limits else "",
        f"– {' '.join(meaning.split())}" if meaning else "",
    ]
    return wrapped(" ".join(filter(None, parts)), "  ")


def wrapped(text: str, indent: str = "") -> list[str]:
    """Lines of at most `LINE` characters."""
    return textwrap.wrap(
        text, LINE, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def shown(value: Any) -> str:
    """A value as in YAML; of a mapping, the names in it."""
    if isinstance(value, dict):
        return f"{{{', '.join(value)}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(shown, value))}]"
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else str(value)


def limits(metadata: list[Any]) -> str:
    """The range of a value, from pydantic's constraints."""
    signs = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
    limits = []
    for constraint in metadata:
        for name, sign in signs.items():
            if (limit := getattr(constraint, name, None)) is not None:
                limits.append(f"{sign} {limit:,}")
    return ", ".join(limits)


def configuration() -> str:
    """The page of all keys."""
    lines = ["", "## The study", "", *section(Config, compose("default", [])), CHOICES]
    for group, prefix in GROUPS.items():
        lines += choices(group, prefix)
    lines += cameras()
    return HEAD + "\n".join(lines).rstrip("\n") + "\n"


def columns() -> str:
    """The page of all columns of the tables of campaigns and regions."""
    parts: list[str] = []
    for name, table in TABLES.items():
        parts += [f"## {name}.parquet", "", *wrapped(TABLE_TEXTS[name]), "", *described(table), ""]
    parts += ["## regions/VERSION/SCENARIO.parquet", "", *wrapped(WHY_TEXT), "", *described(WHY)]
    return COLUMNS_HEAD + "\n".join(parts) + "\n"


def described(table: tuple[Column, ...]) -> list[str]:
    """A Markdown table with a row for each column."""
    rows = ["| column | type | unit | meaning |", "|---|---|---|---|"]
    for column in table:
        kind = " / ".join(column.allowed) or column.kind.__name__
        rows.append(f"| `{column.name}` | {kind} | {column.unit} | {column.meaning} |")
    return rows


def evidence_schema() -> str:
    """The JSON schema of evidence/<version>.json."""
    return json.dumps(Evidence.model_json_schema(), indent=1) + "\n"


PAGES = {
    "configuration.md": configuration,
    "columns.md": columns,
    "evidence.schema.json": evidence_schema,
}


if __name__ == "__main__":
    sys.exit(main())
