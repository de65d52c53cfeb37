"""Every test of a study as data for the report's table, which people sort, filter and brush."""

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
"""Columns of tests.parquet shown besides a test's identity, its end and its variables."""
ISOLATED = "isolated"
UNITS = {column.name: column.unit for column in TESTS}


@dataclass(frozen=True)
class Explorer:
    """The table of every test, packed for the page.

    Attributes:
        how: How to use it.
        data: Columns, compressed, in base64.
        thumbnails: Test -> data: address, as JSON.
    """

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
    """Pack the tests of several campaigns.

    Args:
        tests: Rows of tests.parquet.
        labels: Scenario -> its printed label.
        spaces: Scenario -> its space.
        regions: Failure regions of the scenarios.
        frames: Kept frames of the campaigns with thumbnails.
    """
    colours = {MODE_NAMES[mode]: colour for mode, colour in MODE_COLOURS.items()}
    labelled = tests.assign(scenario=tests["scenario"].map(labels))
    fields = list(_fields(labelled, spaces, regions))
    content = {"colours": {**colours, "error": "#8f98a3"}, "fields": fields}
    text = json.dumps(content, allow_nan=False, separators=(",", ":"))
    packed = base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode()
    ranked = tests.sort_values("failure", ascending=False, kind="stable")["test_id"]
    thumbnails = {}
    for test, jpeg in frames.images(set(ranked[:THUMBNAILS])).items():
        buffer = io.BytesIO()
        small = Image.open(io.BytesIO(jpeg)).resize(THUMBNAIL, Image.Resampling.BOX)
        small.save(buffer, "JPEG", quality=70)
        thumbnails[test] = data_uri(buffer.getvalue(), "image/jpeg")
    return Explorer(texts.EXPLORER, packed, json.dumps(thumbnails))


def groups(regions: FailureRegions) -> dict[str, tuple[str, ...]]:
    """Name in the table -> tests: the failures of each region, then those in no region."""
    members = {region.name: region.members for region in regions.regions}
    return members | {f"{regions.label} {ISOLATED}": regions.isolated}


def _fields(
    tests: pd.DataFrame, spaces: Mapping[str, Space], regions: Iterable[FailureRegions]
) -> Iterator[dict[str, Any]]:
    region_of: dict[str, str] = {}
    for of_scenario in regions:
        for name, members in groups(of_scenario).items():
            region_of |= dict.fromkeys(members, name)
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
    """A variable, then the attributes of its categories.

    same: the variable in each space; held-out people differ from others.
    """
    first = same[0]
    if first.kind != "categorical":
        low = min(variable.low for variable in same)
        high = max(variable.high for variable in same)
        field = _number(first.name, values, first.unit)
        yield {**field, "variable": True, "low": low, "high": high}
        return
    yield {**_text(first.name, values.fillna("")), "variable": True}
    attributes: dict[str, dict[str, float]] = {}
    for variable in same:
        for attribute, numbers in variable.attributes:
            attributes.setdefault(attribute, {}).update(zip(variable.values, numbers, strict=True))
    for attribute, by_category in attributes.items():
        yield _number(attribute, values.map(by_category))


def _text(name: str, values: pd.Series) -> dict[str, Any]:
    codes, categories = pd.factorize(values)
    return {"name": name, "known": [str(value) for value in categories], "codes": codes.tolist()}


def _number(name: str, values: pd.Series, unit: str = "") -> dict[str, Any]:
    numbers: list[float | None] = []
    for value in values:
        number = None if pd.isna(value) else float(f"{value:.{DIGITS}g}")
        whole = number is not None and number == int(number)
        numbers.append(int(number) if whole and number is not None else number)
    return {"name": name, "unit": unit, "numbers": numbers}
