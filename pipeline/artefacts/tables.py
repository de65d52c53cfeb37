"""The five tables of a campaign.

These are tests, signals, detections, frames and timings, as Parquet with units in the fields'
metadata.

Every write and every read checks the schema. Equal rows give equal bytes; wall-clock times appear
in timings.parquet alone.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.artefacts.files import read_bytes, write_bytes
from pipeline.artefacts.scenario_space import plain_space, space_of
from pipeline.core.boxes import Box
from pipeline.core.columns import Column, columns
from pipeline.core.episode import FrameDetections, KeptFrame
from pipeline.core.identity import CampaignId
from pipeline.core.kpi import KPIS
from pipeline.core.sight import SIGHT
from pipeline.core.signals import SIDES, SIGNALS
from pipeline.core.space import Space
from pipeline.core.truth import Truth
from pipeline.errors import InputError

FORMAT = "1"
TYPES = {
    int: pa.int64(),
    float: pa.float64(),
    bool: pa.bool_(),
    str: pa.string(),
    bytes: pa.binary(),
}
TEST_ID = Column("test_id", str, "scenario, strategy, version, seed and index in one name")
BOXES = {
    "visible": "box around the visible part of the pedestrian",
    "whole": "box around the part that would be visible without occluders",
}
TESTS = (
    TEST_ID,
    *columns(CampaignId),
    Column("index", int, "number of the test in its campaign, from 0"),
    Column("batch", int, "number of the batch that the strategy asked for"),
    Column("status", str, "whether the simulation ended in an error", allowed=("ok", "error")),
    Column("reason", str, "reason of the error, else empty"),
    *KPIS,
)
"""Columns of tests.parquet before the scenario variables. A test with status `error` has a reason
and `NO_KPI`."""
SIGNAL_TABLE = (TEST_ID, Column("step", int, "number of the time step, from 0"), *SIGNALS)
FRAMES = (
    TEST_ID,
    Column("step", int, "number of the time step"),
    Column("image", bytes, "the frame as JPEG"),
    *(
        Column(f"{box}_{side}", float, f"{meaning}; no value if there is none", "px")
        for box, meaning in BOXES.items()
        for side in SIDES
    ),
    Column("visible_pixels", int, "visible pixels of the pedestrian", "px"),
    Column("whole_pixels", int, "pixels that would be visible without occluders", "px"),
    Column(
        "contrast",
        float,
        "mean difference in grey levels between the pedestrian's visible pixels and their "
        "surroundings",
    ),
    Column("false_positives", int, "false positives of the detector in this frame"),
    Column(
        "confidence",
        float,
        "score of its best detection on the pedestrian, reported or not, 0 if there is none",
    ),
)
DETECTIONS = (
    TEST_ID,
    Column("step", int, "number of the time step"),
    *(Column(side, float, "box of a detection", "px") for side in SIDES),
    Column(
        "score",
        float,
        "its score, at least 0.05, or the detector's threshold if that is lower; a detection below "
        "the threshold is not reported",
    ),
    Column("in_path", bool, "whether the foot of the box lies in the ego's path"),
)
TIMINGS = (
    TEST_ID,
    Column(
        "sampler_s",
        float,
        "time that the strategy took to choose the test: an equal share of its batch's time",
        "s",
    ),
    Column("simulate_s", float, "time that the execution took", "s"),
)
TABLES: Mapping[str, tuple[Column, ...]] = {
    "tests": TESTS,
    "signals": SIGNAL_TABLE,
    "detections": DETECTIONS,
    "frames": FRAMES,
    "timings": TIMINGS,
}
UNCHANGED = "none"
"""The change of a row of a failure as its campaign executed it."""
WHY = (
    Column("region", str, "name of the region"),
    Column("test_id", str, "a failure of the region"),
    Column(
        "change",
        str,
        f"what is changed, such as `no rain`; `{UNCHANGED}` is the failure as its campaign "
        "executed it",
    ),
    Column("status", str, "whether the simulation ended in an error", allowed=("ok", "error")),
    Column("reason", str, "reason of the error, else empty"),
    Column("failure", bool, "whether it fails with the change"),
    Column(
        "adj_ttc_s", float, "adjusted time-to-collision with the change; no value for an error", "s"
    ),
    *SIGHT,
)
"""Columns of the table beside a scenario's regions."""


def write_tests(path: Path, tests: pd.DataFrame, space: Space) -> None:
    """Write one row per test, in the given order.

    The columns are `TESTS`, then the scenario variables (categories by name). The file's metadata
    have the space that the tests were drawn from.
    """
    _write(path, tests, TESTS, space)


def read_tests(path: Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Read tests.parquet, or some of its columns.

    Raises:
        InputError: naming the file if it is truncated or not such a table.
    """
    return _read(path, "tests", columns)


def space_of_tests(path: Path) -> Space:
    """The space that the tests of tests.parquet were drawn from.

    Raises:
        InputError: if the file does not say.
    """
    try:
        return space_of(json.loads((_opened(path).schema_arrow.metadata or {})[b"space"]))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path}: expected the space of its tests in its metadata; make the campaign again"
        ) from error


def is_valid(tests: pd.DataFrame) -> pd.Series[bool]:
    """Which tests have a result; the others ended in an error, which is no failure."""
    return tests["status"] == "ok"


def read_all_tests(paths: Iterable[Path]) -> pd.DataFrame:
    """The rows of several tests.parquet as one table, file by file; ValueError for no file."""
    return pd.concat([read_tests(path) for path in paths], ignore_index=True)


def write_signals(path: Path, signals: pd.DataFrame) -> None:
    """Write one row per time step: test_id, step, then `pipeline.core.signals.SIGNALS`."""
    _write(path, signals, SIGNAL_TABLE)


def read_signals(path: Path) -> pd.DataFrame:
    """Read signals.parquet.

    Raises:
        InputError: naming the file if it is truncated or not such a table.
    """
    return _read(path, "signals")


def write_detections(path: Path, detections: pd.DataFrame) -> None:
    """Write one row per detection: `DETECTIONS`, by test, step and descending score."""
    _write(path, detections, DETECTIONS)


def read_detections(path: Path) -> pd.DataFrame:
    """Read detections.parquet.

    Raises:
        InputError: naming the file if it is truncated or not such a table.
    """
    return _read(path, "detections")


def write_frames(path: Path, frames: pd.DataFrame) -> None:
    """Write one row per kept frame: `FRAMES`."""
    _write(path, frames, FRAMES)


def read_frames(path: Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Read frames.parquet, or some of its columns (without `image` it is small).

    Raises:
        InputError: if it is truncated or not such a table.
    """
    return _read(path, "frames", columns)


def write_timings(path: Path, timings: pd.DataFrame) -> None:
    """Write one row per test: wall-clock seconds to choose it and to execute it."""
    _write(path, timings, TIMINGS)


def read_timings(path: Path) -> pd.DataFrame:
    """Read timings.parquet.

    Raises:
        InputError: naming the file if it is truncated or not such a table.
    """
    return _read(path, "timings")


def write_campaign(out: Path, rows_of: Callable[[str], pd.DataFrame], space: Space) -> None:
    """Write the tables of a campaign beside `out`, its tests.parquet, which comes last.

    Args:
        rows_of: the rows by name, as in `TABLES`, asked for one after the other; a table without
            rows needs no columns.
    """
    writers = {
        "signals": write_signals,
        "detections": write_detections,
        "frames": write_frames,
        "timings": write_timings,
    }
    for name, write in writers.items():
        write(
            out.with_name(f"{name}.parquet"),
            _filled(rows_of(name), [column.name for column in TABLES[name]]),
        )
    write_tests(
        out, _filled(rows_of("tests"), [*(column.name for column in TESTS), *space.names]), space
    )


def _filled(rows: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    return rows if len(rows) else pd.DataFrame(columns=list(names))


def read_campaigns(tests: Sequence[Path], name: str) -> pd.DataFrame:
    """The rows of a table, as in `TABLES`, of several campaigns, one after the other.

    Args:
        tests: of each, its tests.parquet.
    """
    return pd.concat(
        [_read(path.with_name(f"{name}.parquet"), name) for path in tests], ignore_index=True
    )


def write_why(path: Path, rows: pd.DataFrame) -> None:
    """Write the failures of regions, as executed and with single changes: `WHY`."""
    _write(path, rows, WHY)


def campaign_of(tests: pd.DataFrame, path: Path) -> CampaignId:
    """The campaign of the rows of tests.parquet.

    Raises:
        InputError: naming the file if they belong to none or to several.
    """
    campaigns = tests[[column.name for column in columns(CampaignId)]].drop_duplicates()
    if len(campaigns) != 1:
        raise InputError(
            f"{path}: expected the tests of one campaign, got {len(campaigns)} campaigns; "
            "make it again"
        )
    scenario, strategy, version, seed = campaigns.iloc[0]
    return CampaignId(str(scenario), str(strategy), str(version), int(seed))


def frame_row(kept: KeptFrame) -> dict[str, Any]:
    """The row of frames.parquet for a kept frame, without test and image."""
    truth = kept.frame.truth
    row: dict[str, Any] = {"step": kept.step}
    for kind, box in (("visible", truth.visible_box), ("whole", truth.whole_box)):
        row |= {
            f"{kind}_{side}": value for side, value in zip(SIDES, box or (np.nan,) * 4, strict=True)
        }
    row |= {name: getattr(truth, name) for name in ("visible_pixels", "whole_pixels", "contrast")}
    return row | {
        "false_positives": kept.matching.false_positives,
        "confidence": kept.matching.any_confidence,
    }


def frame_truth(row: pd.Series) -> Truth:
    """The ground truth in a row of frames.parquet."""
    visible, whole = frame_box(row, "visible"), frame_box(row, "whole")
    return Truth(
        visible, whole, int(row["visible_pixels"]), int(row["whole_pixels"]), float(row["contrast"])
    )


def frame_box(row: pd.Series, kind: str) -> Box | None:
    """The box `visible` or `whole` in a row of frames.parquet, pixels; None if there is none."""
    left, top, right, bottom = (float(row[f"{kind}_{side}"]) for side in SIDES)
    return None if np.isnan(left) else (left, top, right, bottom)


def _write(
    path: Path, frame: pd.DataFrame, expected: Sequence[Column], space: Space | None = None
) -> None:
    fields = []
    for column in expected:
        unit = {"unit": column.unit} if column.unit else None
        fields.append(pa.field(column.name, TYPES[column.kind], column.kind is float, unit))
    for variable in space.variables if space else ():
        kind = pa.string() if variable.kind == "categorical" else pa.float64()
        unit = {"unit": variable.unit} if variable.unit else None
        fields.append(pa.field(variable.name, kind, nullable=False, metadata=unit))
    schema = pa.schema(fields)
    missing = set(schema.names) - set(frame.columns)
    unknown = set(frame.columns) - set(schema.names)
    if missing or unknown:
        raise ValueError(
            f"{path.name} must have columns {schema.names}; missing {sorted(missing)}, unknown "
            f"{sorted(unknown)}"
        )
    arrays = [pa.array(frame[field.name], field.type, from_pandas=True) for field in schema]
    about = {"blindspot": FORMAT, **({"space": json.dumps(plain_space(space))} if space else {})}
    table = pa.table(arrays, schema=schema.with_metadata(about))
    problem = _problem(table, expected)
    if problem:
        raise ValueError(f"{path.name}: {problem}")
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd", write_page_checksum=True)
    write_bytes(path, buffer.getvalue())


def _read(path: Path, name: str, columns: Sequence[str] | None = None) -> pd.DataFrame:
    expected = TABLES[name]
    wanted = {column.name: TYPES[column.kind] for column in expected}
    file = _opened(path)
    types = {field.name: field.type for field in file.schema_arrow}
    variables = {kind for other, kind in types.items() if other not in wanted}
    if name == "tests" and variables & {pa.string(), pa.float64()}:
        types = {column: kind for column, kind in types.items() if column in wanted}
    if types != wanted:
        wrong = sorted(
            {column for column in {*wanted, *types} if wanted.get(column) != types.get(column)}
        )
        raise InputError(
            f"{path}: expected a {name} table, its columns {wrong} differ; make it again"
        )
    try:
        table = file.read(columns=list(columns) if columns is not None else None)
    except (pa.ArrowException, OSError) as error:
        raise InputError(
            f"{path}: expected a Parquet file, got a damaged one ({error}); if a study made it, "
            "./run makes it again"
        ) from error
    problem = _problem(table, expected)
    if problem:
        raise InputError(f"{path}: {problem}; if a study made it, ./run makes it again")
    frame: pd.DataFrame = table.to_pandas()
    return frame if columns is None else frame[list(columns)]


def _opened(path: Path) -> pq.ParquetFile:
    data = read_bytes(path)
    try:
        return pq.ParquetFile(pa.BufferReader(data), page_checksum_verification=True)
    except (pa.ArrowException, OSError) as error:
        raise InputError(
            f"{path}: expected a Parquet file, got a truncated or foreign one ({error}); if a "
            "study made it, ./run makes it again"
        ) from error


def _problem(table: pa.Table, expected: Sequence[Column]) -> str:
    """The first fault of the rows; empty if there is none."""
    allowed = {column.name: set(column.allowed) for column in expected if column.allowed}
    for field in table.schema:
        column = table.column(field.name)
        if not field.nullable and column.null_count:
            return f"column {field.name} must have no empty rows, got {column.null_count}"
        if field.name not in allowed:
            continue
        foreign = set(column.unique().to_pylist()) - allowed[field.name]
        if foreign:
            expected_values = sorted(allowed[field.name])
            return f"column {field.name} must hold {expected_values}, got {sorted(foreign)}"
    return ""


def detection_columns(detections: Sequence[FrameDetections]) -> dict[str, NDArray[Any]]:
    """The columns of detections.parquet, without test_id, for the detections of a test by time
    step.
    """
    counts = [len(frame.detections.scores) for frame in detections]
    boxes = np.concatenate([np.zeros((0, 4)), *(frame.detections.boxes for frame in detections)])
    scores = np.concatenate([np.zeros(0), *(frame.detections.scores for frame in detections)])
    in_path = np.concatenate([np.zeros(0, bool), *(frame.in_path for frame in detections)])
    return {
        "step": np.repeat(np.arange(len(counts)), counts),
        **dict(zip(SIDES, boxes.T, strict=True)),
        "score": scores,
        "in_path": in_path,
    }
