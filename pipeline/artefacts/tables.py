"""The four tables of a campaign: tests, signals, frames and timings, as Parquet with units in the fields' metadata.

Every write and every read checks the schema. The same rows give the same bytes; clocks appear in timings.parquet alone.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.artefacts.files import write_bytes
from pipeline.core.episode import SIGNALS
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError

FORMAT = "1"
Column = tuple[str, type, str]
"""Name, type and unit."""
ALLOWED = {"status": {"ok", "error"}, "failure_mode": {"none", "contact", "late", "false_positives"}}
TYPES = {int: pa.int64(), float: pa.float64(), bool: pa.bool_(), str: pa.string(), bytes: pa.binary()}
TESTS: tuple[Column, ...] = (
    ("test_id", str, ""),
    ("scenario", str, ""),
    ("strategy", str, ""),
    ("version", str, ""),
    ("seed", int, ""),
    ("index", int, ""),
    ("batch", int, ""),
    ("status", str, ""),
    ("reason", str, ""),
    ("adj_ttc_s", float, "s"),
    ("ttc_s", float, "s"),
    ("failure", bool, ""),
    ("failure_mode", str, ""),
    ("contact", bool, ""),
    ("impact_speed_mps", float, "m/s"),
    ("smallest_gap_m", float, "m"),
    ("post_encroachment_s", float, "s"),
    ("first_detection_s", float, "s"),
    ("first_detection_m", float, "m"),
    ("missed_frames", int, ""),
    ("false_positives", int, ""),
    ("false_positives_far", int, ""),
    ("false_positives_localisation", int, ""),
    ("false_positives_duplicate", int, ""),
)
"""Columns of tests.parquet before the scenario variables. A test with status `error` has a reason, failure false, failure_mode
none, counts of 0 and no value for any other KPI."""
SIGNAL_TYPES: Mapping[type, type] = {np.float64: float, np.int64: int, np.bool_: bool}
SIGNAL_UNITS = {"_mps": "m/s", "_s": "s", "_m": "m", "_pixels": "px"}


def _unit(name: str) -> str:
    return next((unit for suffix, unit in SIGNAL_UNITS.items() if name.endswith(suffix)), "")


SIGNAL_TABLE: tuple[Column, ...] = (
    ("test_id", str, ""),
    ("step", int, ""),
    *((name, SIGNAL_TYPES[kind], _unit(name)) for name, kind in SIGNALS.items()),
)
SIGNAL_COLUMNS = tuple(name for name, _, _ in SIGNAL_TABLE)
FRAMES: tuple[Column, ...] = (
    ("test_id", str, ""),
    ("step", int, ""),
    ("image", bytes, ""),
    *((f"{box}_{side}", float, "px") for box in ("visible", "whole") for side in ("left", "top", "right", "bottom")),
    ("visible_pixels", int, "px"),
    ("whole_pixels", int, "px"),
    ("contrast", float, ""),
    ("false_positives", int, ""),
    ("confidence", float, ""),
)
"""Columns of frames.parquet: a JPEG, the pedestrian's boxes (no value where nothing shows) and what the detector said."""
TIMINGS: tuple[Column, ...] = (("test_id", str, ""), ("sampler_s", float, "s"), ("simulate_s", float, "s"))


def write_tests(path: Path, tests: pd.DataFrame, space: Space) -> None:
    """Write one row a test, in the order given: `TESTS`, then one column a scenario variable (categories by name)."""
    _write(path, tests, pa.schema([*_fields(TESTS), *map(_variable_field, space.variables)]))


def read_tests(path: Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Read tests.parquet, or some of its columns; InputError that names the file if it is truncated or another table."""
    return _read(path, TESTS, columns, variables=True)


def write_signals(path: Path, signals: pd.DataFrame) -> None:
    """Write one row a time step: test_id, step, then `pipeline.protocols.SIGNALS`."""
    _write(path, signals, pa.schema(_fields(SIGNAL_TABLE)))


def read_signals(path: Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Read signals.parquet; InputError that names the file if it is truncated or another table."""
    return _read(path, SIGNAL_TABLE, columns)


def write_frames(path: Path, frames: pd.DataFrame) -> None:
    """Write one row a kept frame: `FRAMES`."""
    _write(path, frames, pa.schema(_fields(FRAMES)))


def read_frames(path: Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Read frames.parquet, or some of its columns (without `image` it is small); InputError if it is truncated or foreign."""
    return _read(path, FRAMES, columns)


def write_timings(path: Path, timings: pd.DataFrame) -> None:
    """Write one row a test: seconds of wall clock that choosing it and executing it took."""
    _write(path, timings, pa.schema(_fields(TIMINGS)))


def read_timings(path: Path) -> pd.DataFrame:
    """Read timings.parquet; InputError that names the file if it is truncated or another table."""
    return _read(path, TIMINGS, None)


def _fields(columns: Sequence[Column]) -> list[pa.Field]:
    return [pa.field(name, TYPES[kind], kind is float, {"unit": unit} if unit else None) for name, kind, unit in columns]


def _variable_field(variable: Variable) -> pa.Field:
    kind = pa.string() if variable.kind == "categorical" else pa.float64()
    return pa.field(variable.name, kind, nullable=False, metadata={"unit": variable.unit} if variable.unit else None)


def _write(path: Path, frame: pd.DataFrame, schema: pa.Schema) -> None:
    missing, unknown = set(schema.names) - set(frame.columns), set(frame.columns) - set(schema.names)
    if missing or unknown:
        raise ValueError(f"{path.name} must have columns {schema.names}; missing {sorted(missing)}, unknown {sorted(unknown)}")
    arrays = [pa.array(frame[field.name], field.type, from_pandas=True) for field in schema]
    table = pa.table(arrays, schema=schema.with_metadata({"blindspot": FORMAT}))
    problem = _problem(table)
    if problem:
        raise ValueError(f"{path.name}: {problem}")
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    write_bytes(path, buffer.getvalue())


def _read(path: Path, expected: Sequence[Column], columns: Sequence[str] | None, variables: bool = False) -> pd.DataFrame:
    schema = _schema(path)
    wanted = {field.name: field.type for field in _fields(expected)}
    found = {field.name: field.type for field in schema}
    if variables and any(kind in (pa.string(), pa.float64()) for name, kind in found.items() if name not in wanted):
        found = {name: kind for name, kind in found.items() if name in wanted}
    if found != wanted:
        wrong = sorted({name for name in {*wanted, *found} if wanted.get(name) != found.get(name)})
        raise InputError(f"{path}: expected a {_table_name(expected)} table, its columns {wrong} differ; make it again")
    try:
        table = pq.ParquetFile(path).read(columns=list(columns) if columns is not None else None)
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"{path}: expected a Parquet file, it is damaged ({error}); delete it and make it again") from error
    problem = _problem(table)
    if problem:
        raise InputError(f"{path}: {problem}; delete it and make it again")
    frame: pd.DataFrame = table.to_pandas()
    return frame if columns is None else frame[list(columns)]


def _table_name(expected: Sequence[Column]) -> str:
    return {len(TESTS): "tests", len(SIGNAL_TABLE): "signals", len(FRAMES): "frames"}.get(len(expected), "timings")


def _schema(path: Path) -> pa.Schema:
    if not path.is_file():
        raise InputError(f"{path}: expected a Parquet file, found none; make it with snakemake")
    try:
        return pq.read_schema(path)
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"{path}: expected a Parquet file, it is truncated or foreign ({error}); delete it and make it again") from error


def _problem(table: pa.Table) -> str:
    """What is wrong with the rows; empty if nothing is."""
    for field in table.schema:
        column = table.column(field.name)
        if not field.nullable and column.null_count:
            return f"column {field.name} must have no empty rows, got {column.null_count}"
        foreign = set(column.unique().to_pylist()) - ALLOWED[field.name] if field.name in ALLOWED else set()
        if foreign:
            return f"column {field.name} must hold {sorted(ALLOWED[field.name])}, got {sorted(foreign)}"
    return ""
