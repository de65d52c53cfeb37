"""Every test of a study as data for the report's table, which people sort, filter and brush in the browser."""

from __future__ import annotations

import base64
import gzip
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd
from PIL import Image

from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.tables import TESTS, is_valid
from pipeline.core.space import Space, Variable
from pipeline.report import texts
from pipeline.report.failure_tables import CAUSES
from pipeline.report.kept_frames import KeptFrames
from pipeline.report.style import MODE_COLOURS, MODE_NAMES, data_uri

DIGITS = 6
"""Significant digits of a number."""
THUMBNAILS = 300
THUMBNAIL = (160, 96)
"""Width and height in pixels."""
KPIS = ("adj_ttc_s", "impact_speed_mps", "first_detection_m", "missed_frames", "false_positives")
"""Columns of tests.parquet that the table shows beside a test's identity, its end and its variables."""
ISOLATED = "isolated"
UNITS = {column.name: column.unit for column in TESTS}


@dataclass(frozen=True)
class Explorer:
    """how: how to use it. data: columns, compressed and in base64. thumbnails: test -> data: address, as JSON."""

    how: str
    data: str
    thumbnails: str


def explorer(
    tests: pd.DataFrame,
    labels: Mapping[str, str],
    spaces: Mapping[str, Space],
    regions: Iterable[FailureRegions],
    frames: KeptFrames,
) -> Explorer:
    """The rows of tests.parquet of several campaigns. labels, spaces: of their scenarios. frames: of campaigns with thumbnails."""
    fields = list(_fields(tests.assign(scenario=tests["scenario"].map(labels)), spaces, regions))
    content = {
        "colours": {
            **{MODE_NAMES[mode]: colour for mode, colour in MODE_COLOURS.items()},
            "error": "#8f98a3",
        },
        "fields": fields,
    }
    packed = gzip.compress(
        json.dumps(content, allow_nan=False, separators=(",", ":")).encode(), mtime=0
    )
    return Explorer(
        texts.EXPLORER, base64.b64encode(packed).decode(), json.dumps(_thumbnails(tests, frames))
    )


def groups(found: FailureRegions) -> dict[str, tuple[str, ...]]:
    """The failures of each region and those in none, by the name that the table has for them."""
    return {region.name: region.members for region in found.regions} | {
        f"{found.label} {ISOLATED}": found.isolated
    }


def _fields(
    tests: pd.DataFrame, spaces: Mapping[str, Space], regions: Iterable[FailureRegions]
) -> Iterator[dict[str, Any]]:
    region_of = {
        test: name
        for found in regions
        for name, tests_of in groups(found).items()
        for test in tests_of
    }
    yield _text("test", tests["test_id"])
    for name in ("scenario", "strategy", "version"):
        yield _text(name, tests[name])
    yield _number("index", tests["index"])
    yield _text("end", tests["failure_mode"].map(MODE_NAMES).where(is_valid(tests), "error"))
    yield _text("cause", tests["cause"].map({**CAUSES, "none": ""}))
    yield _text("region", tests["test_id"].map(region_of).fillna(""))
    for name in KPIS:
        yield _number(name, tests[name].where(is_valid(tests)), UNITS[name])
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
        low, high = min(one.low for one in same), max(one.high for one in same)
        yield {
            **_number(first.name, values, first.unit),
            "variable": True,
            "low": low,
            "high": high,
        }
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
    return {
        "name": name,
        "unit": unit,
        "numbers": [int(n) if n is not None and n == int(n) else n for n in numbers],
    }


def _thumbnails(tests: pd.DataFrame, frames: KeptFrames) -> dict[str, str]:
    """The decisive moment of the first tests, failures first."""
    ranked = tests.sort_values("failure", ascending=False, kind="stable")["test_id"]
    return {test: _small(image) for test, image in frames.images(set(ranked[:THUMBNAILS])).items()}


def _small(jpeg: bytes) -> str:
    buffer = io.BytesIO()
    Image.open(io.BytesIO(jpeg)).resize(THUMBNAIL, Image.Resampling.BOX).save(
        buffer, "JPEG", quality=70
    )
    return data_uri(buffer.getvalue(), "image/jpeg")
