"""CSV and Parquet tables: columns by name, CSV's values as the text that is written."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import csv as pa_csv

from pipeline.artefacts.files import read_bytes, write_bytes
from pipeline.errors import InputError

CSV, PARQUET = ("", ".csv", ".txt"), (".parquet", ".pq")
READ = "a CSV or parquet table"
ALL_READ = f"{', '.join((*CSV[1:], *PARQUET))}, COCO's .json and folders of YOLO labels"
SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
UNQUOTED = re.compile(r'[^\s",\ufeff]([^",\r\n]*[^\s",])?', re.ASCII)
QUOTED = re.compile(rb'(?<![^,\r\n])[ \t]*("[^"]*(?:""[^"]*)*")')
OPENED = re.compile(rb'(?<![^,\r\n])[ \t]*"')
NO_ROWS = re.compile(rb"[\r\n]*")
BLOCK = 1 << 24


@dataclass(frozen=True)
class Table:
    """header: names of all columns. columns: those asked for, as Arrow arrays; a CSV has texts, and null for nothing between commas."""

    header: tuple[str, ...]
    columns: dict[str, Any]
    rows: int


def read_table(path: Path, wanted: Sequence[str]) -> Table:
    """The columns of a table that are wanted and there.

    Raises InputError that names the file and what is wrong: another format or separator, a wanted column twice, a row with more or fewer
    fields than the header.
    """
    if not path.exists():
        raise InputError(f"{path}: expected {READ}, got no such file")
    try:
        if path.suffix.lower() in PARQUET:
            return _read_parquet(path, wanted)
        if path.suffix.lower() in CSV:
            return _read_csv(path, read_bytes(path), wanted)
    except InputError:
        raise
    except (ValueError, OSError, pa.ArrowException, csv.Error) as error:
        raise InputError(f"{path}: expected {READ}, got {str(error).splitlines()[0]}") from error
    raise InputError(f"{path}: expected {READ}, got {path.suffix}; what can be read: {ALL_READ}")


def check_format(path: Path) -> None:
    """InputError if the name of a table to write is that of another format."""
    if path.suffix.lower() not in (*CSV, *PARQUET):
        raise InputError(f"{path}: expected a name that ends in .csv or .parquet, got {path.suffix}")


def write_table(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write texts as parquet or, by any other name, CSV."""
    if path.suffix.lower() in PARQUET:
        columns = [pa.array(column, pa.string()) for column in zip(*rows, strict=True)] or [pa.array([], pa.string())] * len(header)
        buffer = io.BytesIO()
        pq.write_table(pa.Table.from_arrays(columns, list(header)), buffer)
        write_bytes(path, buffer.getvalue())
    else:
        write_bytes(path, "".join(",".join(map(_field, row)) + "\n" for row in (header, *rows)).encode())


def _field(text: str) -> str:
    return text if UNQUOTED.fullmatch(text) else '"' + text.replace('"', '""') + '"'


def _read_parquet(path: Path, wanted: Sequence[str]) -> Table:
    with pq.ParquetFile(path) as file:
        header = tuple(file.schema_arrow.names)
        places = _places(path, header, wanted)
        table = file.read(columns=[header[place] for place in places.values()])
        return Table(header, {name: table.column(header[place]) for name, place in places.items()}, file.metadata.num_rows)


def _read_csv(path: Path, data: bytes, wanted: Sequence[str]) -> Table:
    data = data.removeprefix(b"\xef\xbb\xbf").lstrip(b"\r\n")
    if b' "' in data:  # Arrow takes a quote after a space for text.
        data = QUOTED.sub(rb"\1", data)
    if data.count(b'"') % 2 and OPENED.search(QUOTED.sub(b"", data)):
        raise InputError(f"{path}: a quote is opened and never closed")
    header, rest = _header(data)
    if not header:
        return Table((), {}, 0)
    places = _places(path, header, wanted)
    if not places and len(header) == 1 and (found := [name for separator, name in SEPARATORS.items() if separator in header[0]]):
        raise InputError(f"{path}: expected commas between the columns, got {found[0]}")
    table = _parse(path, rest, len(header), places)
    return Table(header, {name: table.column(str(place)) for name, place in places.items()}, table.num_rows)


def _header(data: bytes) -> tuple[tuple[str, ...], memoryview]:
    """The names in the first row, and the rows after it: Arrow's own ways to skip a header lose rows after some of them."""
    read = 0

    def lines() -> Iterator[str]:
        nonlocal read
        for line in io.TextIOWrapper(io.BytesIO(data), "utf-8", newline=""):
            read += len(line.encode())
            yield line

    return tuple(next(csv.reader(lines()), ())), memoryview(data)[read:]


def _places(path: Path, header: Sequence[str], wanted: Sequence[str]) -> dict[str, int]:
    """Position of each wanted column that is there: by its name, else by its name without spaces around it."""
    places = {}
    for name in wanted:
        found = [i for i, known in enumerate(header) if known == name]
        found = found or [i for i, known in enumerate(header) if known.strip() == name and known not in wanted]
        if len(found) > 1:
            raise InputError(f"{path}: the column '{name}' appears twice")
        if found:
            places[name] = found[0]
    return places


def _parse(path: Path, rows: memoryview, fields: int, places: dict[str, int]) -> Any:
    """The columns at `places`, named by their positions."""
    if NO_ROWS.fullmatch(rows):
        return pa.table({str(place): pa.array([], pa.string()) for place in places.values()})
    wrong: list[Any] = []

    def refuse(row: Any) -> str:
        wrong.append(row)
        return "error"

    kept = [str(place) for place in places.values()] or ["0"]
    try:
        return pa_csv.read_csv(
            pa.BufferReader(rows),
            # One thread: only then a wrong row has its number.
            pa_csv.ReadOptions(use_threads=False, block_size=BLOCK, column_names=[str(i) for i in range(fields)]),
            pa_csv.ParseOptions(newlines_in_values=True, invalid_row_handler=refuse),
            pa_csv.ConvertOptions(
                include_columns=kept,
                column_types=dict.fromkeys(kept, pa.string()),
                null_values=[""],
                strings_can_be_null=True,
                quoted_strings_can_be_null=False,
            ),
        )
    except pa.ArrowInvalid:
        if not wrong:
            raise
        row = wrong[0]
        raise InputError(
            f"{path}: row {row.number} has {row.actual_columns} fields, the header {row.expected_columns}: {row.text[:80]!r}"
        ) from None
