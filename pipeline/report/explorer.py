"""Every test of a study as data for the report's table, which people sort, filter and brush in the browser."""

from __future__ import annotations

import base64
import gzip
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from PIL import Image

from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.tables import TESTS, read_frames
from pipeline.core.space import Space, Variable
from pipeline.report import texts
from pipeline.report.failure_tables import CAUSES
from pipeline.report.style import MODE_COLOURS, MODE_NAMES, data_uri

DIGITS = 6
"""Significant digits of a number."""
THUMBNAILS = 300
THUMBNAIL = (160, 96)
"""Width and height in pixels."""
KPIS = ("adj_ttc_s", "impact_speed_mps", "first_detection_m", "missed_frames", "false_positives")
"""Columns of tests.parquet that the table shows beside a test's identity, its end and its variables."""
UNITS = {column.name: column.unit for column in TESTS}


@dataclass(frozen=True)
class Explorer:
    """how: how to use it. data: columns, compressed and in base64. thumbnails: test -> data: address, as JSON."""

    how: str
    data: str
    thumbnails: str


def explorer(tests: pd.DataFrame, spaces: Mapping[str, Space], regions: Iterable[FailureRegions], frames: Sequence[Path]) -> Explorer:
    """The rows of tests.parquet of several campaigns. spaces: of their scenarios. frames: frames.parquet of campaigns with thumbnails."""
    fields = list(_fields(tests, spaces, regions))
    content = {"colours": {**{MODE_NAMES[mode]: colour for mode, colour in MODE_COLOURS.items()}, "error": "#8f98a3"}, "fields": fields}
    packed = gzip.compress(json.dumps(content, allow_nan=False, separators=(",", ":")).encode(), mtime=0)
    return Explorer(texts.EXPLORER, base64.b64encode(packed).decode(), json.dumps(_thumbnails(tests, frames)))


def _fields(tests: pd.DataFrame, spaces: Mapping[str, Space], regions: Iterable[FailureRegions]) -> Iterator[dict[str, Any]]:
    region_of = {test: region.name for found in regions for region in found.regions for test in region.members}
    yield _text("test", tests["test_id"])
    for name in ("scenario", "strategy", "version"):
        yield _text(name, tests[name])
    yield _number("index", tests["index"])
    yield _text("end", tests["failure_mode"].map(MODE_NAMES).where(tests["status"] == "ok", "error"))
    yield _text("cause", tests["cause"].map({**CAUSES, "none": ""}))
    yield _text("region", tests["test_id"].map(region_of).fillna(""))
    for name in KPIS:
        yield _number(name, tests[name].where(tests["status"] == "ok"), UNITS[name])
    variables: dict[str, list[Variable]] = {}
    for space in spaces.values():
        for variable in space.variables:
            variables.setdefault(variable.name, []).append(variable)
    for name, same in variables.items():
        yield from _of_variable(same, tests[name])


def _of_variable(same: Sequence[Variable], values: pd.Series) -> Iterator[dict[str, Any]]:
    """A variable, then the attributes of its categories. same: the variable in each space; held-out people differ from others."""
    first = same[0]
    if first.kind != "categorical":
        yield {**_number(first.name, values, first.unit), "variable": True, "low": first.low, "high": first.high}
        return
    yield {**_text(first.name, values.fillna("")), "variable": True}
    attributes: dict[str, dict[str, float]] = {}
    for variable in same:
        for attribute, numbers in variable.attributes:
            attributes.setdefault(attribute, {}).update(zip(variable.values, numbers, strict=True))
    for attribute, known in attributes.items():
        yield _number(attribute, values.map(known))


def _text(name: str, values: pd.Series) -> dict[str, Any]:
    codes, known = pd.factorize(values)
    return {"name": name, "known": [str(value) for value in known], "codes": codes.tolist()}


def _number(name: str, values: pd.Series, unit: str = "") -> dict[str, Any]:
    numbers = (None if pd.isna(value) else float(f"{value:.{DIGITS}g}") for value in values)
    return {"name": name, "unit": unit, "numbers": [int(n) if n is not None and n == int(n) else n for n in numbers]}


def _thumbnails(tests: pd.DataFrame, frames: Sequence[Path]) -> dict[str, str]:
    """A moment of the first tests, failures first: three quarters through the kept frames that show the pedestrian."""
    ranked = tests.sort_values("failure", ascending=False, kind="stable")["test_id"]
    wanted = set(ranked[:THUMBNAILS])
    return dict(thumbnail for path in frames for thumbnail in _of_campaign(path, wanted))


def _of_campaign(path: Path, wanted: set[str]) -> Iterator[tuple[str, str]]:
    rows = read_frames(path, ["test_id", "visible_pixels"])
    chosen = [_most_telling(group) for test, group in rows.groupby("test_id", sort=False) if test in wanted]
    if chosen:
        images = read_frames(path, ["image"])["image"]
        yield from ((str(rows["test_id"][row]), _small(images[row])) for row in chosen)


def _most_telling(frames: pd.DataFrame) -> int:
    shown = frames.index[frames["visible_pixels"] > 0]
    return int(shown[max(0, len(shown) * 3 // 4 - 1)] if len(shown) else frames.index[0])


def _small(jpeg: bytes) -> str:
    buffer = io.BytesIO()
    Image.open(io.BytesIO(jpeg)).resize(THUMBNAIL, Image.Resampling.BOX).save(buffer, "JPEG", quality=70)
    return data_uri(buffer.getvalue(), "image/jpeg")
