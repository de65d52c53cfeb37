"""Reads CSV in blocks of whole rows, so that a table never lies in memory; values are the texts that are written."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numba import njit
from numpy.typing import NDArray
from pyarrow import csv as pa_csv

from pipeline.errors import InputError

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
QUOTED = re.compile(rb'(?<![^,\r\n])[ \t]*("[^"]*(?:""[^"]*)*")')
NO_ROWS = re.compile(rb"[\r\n]*")
BLOCK = 1 << 24
"""Bytes that are read at a time."""
LONGEST_ROW = 1 << 26
COMMA, QUOTE, SPACE, TAB, LINE, RETURN = b'," \t\n\r'
START, PLAIN, INSIDE, CLOSING = range(4)
"""Where a byte of a field may be: before it, in it without quotes, inside quotes, after a quote that closes or is doubled."""


def open_csv(path: Path, wanted: Sequence[str]) -> tuple[tuple[str, ...], Iterator[Any]]:
    """The names of all columns, and batches of those that are wanted and there, as Arrow tables with null for nothing between commas."""
    blocks = whole_rows(path)
    header, rest = _header(next(blocks, b""))
    places = column_places(path, header, wanted)
    if (
        not places
        and len(header) == 1
        and (found := [name for separator, name in SEPARATORS.items() if separator in header[0]])
    ):
        raise InputError(f"{path}: expected commas between the columns, got {found[0]}")
    # Arrow takes no column at all for all columns.
    return header, _batches(path, len(header), places, rest, blocks) if places else iter(())


def column_places(path: Path, header: Sequence[str], wanted: Sequence[str]) -> dict[str, int]:
    """Position of each wanted column that is there: by its name, else by its name without spaces around it."""
    places = {}
    for name in wanted:
        found = [i for i, known in enumerate(header) if known == name]
        found = found or [
            i for i, known in enumerate(header) if known.strip() == name and known not in wanted
        ]
        if len(found) > 1:
            raise InputError(f"{path}: the column '{name}' appears twice")
        if found:
            places[name] = found[0]
    return places


def whole_rows(path: Path) -> Iterator[bytes]:
    """The rows of a file in blocks of about `BLOCK` bytes, without spaces before quotes, which Arrow takes for text."""
    with path.open("rb") as file:
        rest = file.read(BLOCK).removeprefix(BYTE_ORDER_MARK).lstrip(b"\r\n")
        while more := file.read(BLOCK):
            end, _ = _end_of_rows(rest)
            if len(rest) - end > LONGEST_ROW:
                raise InputError(
                    f"{path}: a row is longer than {LONGEST_ROW >> 20} MB; perhaps a quote is opened and never closed"
                )
            if end:
                yield _cleaned(rest[:end])
            rest = rest[end:] + more
    if _end_of_rows(rest)[1]:
        raise InputError(f"{path}: a quote is opened and never closed")
    if rest:
        yield _cleaned(rest)


def _end_of_rows(data: bytes) -> tuple[int, bool]:
    """Position after the last line end that ends a row, and whether a quote is open at the end of the data."""
    if b'"' in data:
        end, opened = _scan(np.frombuffer(data, np.uint8))
        return int(end), bool(opened)
    return max(data.rfind(b"\n"), data.rfind(b"\r", 0, -1)) + 1, False


@njit(cache=True)  # type: ignore[untyped-decorator]
def _scan(data: NDArray[np.uint8]) -> tuple[int, bool]:
    end, state = 0, START
    for place in range(len(data)):
        byte = data[place]
        if state == INSIDE:
            state = CLOSING if byte == QUOTE else INSIDE
        elif byte == QUOTE and state in (CLOSING, START):
            state = INSIDE
        elif byte in (LINE, RETURN):
            state = START
            if byte == LINE or place + 1 < len(data):  # A line end may be two bytes.
                end = place + 1
        elif byte == COMMA:
            state = START
        elif state != START or (byte != SPACE and byte != TAB):
            state = PLAIN
    return end, state == INSIDE


def _cleaned(rows: bytes) -> bytes:
    return QUOTED.sub(rb"\1", rows) if b' "' in rows or b'\t"' in rows else rows


def _header(block: bytes) -> tuple[tuple[str, ...], memoryview]:
    """The names in the first row, and the rows after it: Arrow's own ways to skip a header lose rows after some of them."""
    read = 0

    def lines() -> Iterator[str]:
        nonlocal read
        for line in io.TextIOWrapper(io.BytesIO(block), "utf-8", "surrogateescape", newline=""):
            read += len(line.encode("utf-8", "surrogateescape"))
            yield line

    header = tuple(next(csv.reader(lines()), ()))
    ",".join(
        header
    ).encode()  # Bytes that are no text are refused, but only in the header: Arrow refuses those in rows.
    return header, memoryview(block)[read:]


def _batches(
    path: Path, fields: int, places: dict[str, int], first: memoryview, blocks: Iterator[bytes]
) -> Iterator[Any]:
    done = 0
    for rows in chain([first], map(memoryview, blocks)):
        if not NO_ROWS.fullmatch(rows):
            table = _parsed(path, rows, fields, list(places.values()), done)
            done += table.num_rows
            yield table.rename_columns(list(places))


def _parsed(path: Path, rows: memoryview, fields: int, places: list[int], done: int) -> Any:
    """The columns at `places` of rows that come after `done` others; InputError that names a row with a wrong number of fields."""
    wrong: list[Any] = []

    def refuse(row: Any) -> str:
        wrong.append(row)
        return "error"

    def parse(threads: bool) -> Any:
        kept = list(map(str, places))
        return pa_csv.read_csv(
            pa.BufferReader(rows),
            pa_csv.ReadOptions(
                use_threads=threads,
                block_size=len(rows) + 1,
                column_names=[str(i) for i in range(fields)],
            ),
            pa_csv.ParseOptions(newlines_in_values=True, invalid_row_handler=refuse),
            pa_csv.ConvertOptions(
                include_columns=kept,
                column_types=dict.fromkeys(kept, pa.dictionary(pa.int32(), pa.string())),
                null_values=[""],
                strings_can_be_null=True,
                quoted_strings_can_be_null=False,
            ),
        )

    try:
        return parse(threads=True)
    except pa.ArrowInvalid:
        if not wrong:
            raise
    try:
        wrong.clear()
        return parse(threads=False)  # Only one thread knows the number of a wrong row.
    except pa.ArrowInvalid:
        row = wrong[0]
        said = f"row {done + row.number} has {row.actual_columns} fields, the header {row.expected_columns}: {row.text[:80]!r}"
        raise InputError(f"{path}: {said}") from None
