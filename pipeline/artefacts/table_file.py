"""CSV and Parquet tables: columns by name, CSV's values as the text that is written."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.artefacts.csv_batches import column_places, open_csv
from pipeline.artefacts.data_set import IMAGE_SETS
from pipeline.artefacts.files import write_bytes
from pipeline.errors import InputError

CSV, PARQUET = ("", ".csv", ".txt"), (".parquet", ".pq")
READ = "a CSV or parquet table"
ALL_READ = f"{', '.join((*CSV[1:], *PARQUET))}, {IMAGE_SETS}"
UNQUOTED = re.compile(r'[^\s",\ufeff]([^",\r\n]*[^\s",])?', re.ASCII)
BATCH_ROWS = 1 << 17
BUFFER = 1 << 20
"""Bytes that Parquet's reader keeps of each column."""


@dataclass(frozen=True)
class OpenTable:
    """A table that is read batch by batch.

    Attributes:
        header: names of all columns.
        columns: those asked for that are there.
        batches: Arrow tables of these, to be read once; a CSV has texts, and null for nothing
            between commas.
    """

    header: tuple[str, ...]
    columns: tuple[str, ...]
    batches: Iterator[Any]


@dataclass(frozen=True)
class Table:
    """A whole table.

    Attributes:
        header: names of all columns.
        columns: those asked for that are there, as Arrow arrays.
    """

    header: tuple[str, ...]
    columns: dict[str, Any]
    rows: int


def open_table(path: Path, wanted: Sequence[str]) -> OpenTable:
    """Open a table to read the columns that are wanted and there batch by batch, the next batch
    while one is in use.

    Raises:
        InputError: here or from the batches, that names the file and what is wrong: another format
            or separator, a wanted column twice, a row with more or fewer fields than the header.
    """
    if not path.exists():
        raise InputError(f"{path}: expected {READ}, got no such file")
    opener = open_csv if path.suffix.lower() in CSV else _open_parquet
    if path.suffix.lower() not in (*CSV, *PARQUET):
        raise InputError(
            f"{path}: expected {READ}, got {path.suffix}; what can be read: {ALL_READ}"
        )
    with _named(path):
        header, batches = opener(path, wanted)
    return OpenTable(header, tuple(column_places(path, header, wanted)), _ahead(path, batches))


def read_table(path: Path, wanted: Sequence[str]) -> Table:
    """The wanted columns of a whole table; errors as `open_table`."""
    table = open_table(path, wanted)
    batches = list(table.batches)
    if not batches:
        return Table(
            table.header, {name: pa.chunked_array([], pa.string()) for name in table.columns}, 0
        )
    whole = pa.concat_tables(batches).unify_dictionaries()
    return Table(
        table.header, dict(zip(whole.column_names, whole.columns, strict=True)), whole.num_rows
    )


@contextmanager
def _named(path: Path) -> Iterator[None]:
    try:
        yield
    except InputError:
        raise
    except (ValueError, OSError, pa.ArrowException, csv.Error) as error:
        raise InputError(f"{path}: expected {READ}, got {str(error).splitlines()[0]}") from error


def _ahead(path: Path, batches: Iterator[Any]) -> Iterator[Any]:
    """The batches, each read while the one before it is in use."""
    with ThreadPoolExecutor(1) as reader:
        coming = reader.submit(next, batches, None)
        while True:
            with _named(path):
                batch = coming.result()
            if batch is None:
                return
            coming = reader.submit(next, batches, None)
            yield batch


def check_format(path: Path) -> None:
    """InputError if the name of a table to write is that of another format."""
    if path.suffix.lower() not in (*CSV, *PARQUET):
        raise InputError(
            f"{path}: expected a name that ends in .csv or .parquet, got {path.suffix}"
        )


def write_table(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write texts as parquet or, by any other name, CSV."""
    if path.suffix.lower() in PARQUET:
        columns = []
        for place in range(len(header)):
            columns.append(pa.array([row[place] for row in rows], pa.string()))
        buffer = io.BytesIO()
        pq.write_table(pa.Table.from_arrays(columns, list(header)), buffer)
        write_bytes(path, buffer.getvalue())
    else:
        lines = []
        for row in (header, *rows):
            fields = []
            for text in row:
                quoted = '"' + text.replace('"', '""') + '"'
                fields.append(text if UNQUOTED.fullmatch(text) else quoted)
            lines.append(",".join(fields) + "\n")
        write_bytes(path, "".join(lines).encode())


def _open_parquet(path: Path, wanted: Sequence[str]) -> tuple[tuple[str, ...], Iterator[Any]]:
    with pq.ParquetFile(path) as file:
        schema = file.schema_arrow
    header = tuple(schema.names)
    places = column_places(path, header, wanted)
    texts = [
        header[place] for place in places.values() if pa.types.is_string(schema.field(place).type)
    ]

    def batches() -> Iterator[Any]:
        # Buffered: else a whole column of a row group lies in memory.
        with pq.ParquetFile(path, read_dictionary=texts, buffer_size=BUFFER) as opened:
            for batch in opened.iter_batches(
                BATCH_ROWS, columns=[header[place] for place in places.values()], use_threads=False
            ):
                yield pa.table(
                    {name: batch.column(header[place]) for name, place in places.items()}
                )

    return header, batches()
