"""Reads a CSV in batches of rows with Arrow; the values are texts, spelt as in the file."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import csv as pa_csv

from pipeline.errors import InputError

SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
SPACE_BEFORE_QUOTE = re.compile(rb'(?:\A|(?<=[,\r\n]))[ \t]+(?=")')
BLOCK = 1 << 24
"""Bytes that are parsed at a time; no row may be longer."""
ROW_ERROR = re.compile(r"Row #(\d+): (.*)")


def open_csv(path: Path, wanted: Sequence[str]) -> tuple[tuple[str, ...], Iterator[Any]]:
    """Open a CSV with a header.

    Args:
        path: the file, UTF-8 with or without a byte order mark.
        wanted: names of the columns to read; those that the file lacks are left out.

    Returns:
        The names of all columns, and batches of the wanted ones as Arrow tables of texts, with
        null where nothing stands between two commas.

    Raises:
        InputError: here or from the batches, for a wanted column that appears twice, another
            separator, a row with more or fewer fields than the header, a quote that is never
            closed, a row of more than `BLOCK` bytes or bytes that are not UTF-8.
    """
    header = _header(path)
    places = column_places(path, header, wanted)
    if not places and len(header) == 1:
        for separator, name in SEPARATORS.items():
            if separator in header[0]:
                raise InputError(f"{path}: expected commas between the columns, got {name}")
    # Arrow reads an empty list of columns as all columns.
    return header, _batches(path, len(header), places) if places else iter(())


def column_places(path: Path, header: Sequence[str], wanted: Sequence[str]) -> dict[str, int]:
    """Position of each wanted column, by its name or, failing that, its name without spaces."""
    places = {}
    for name in wanted:
        matches = [i for i, column in enumerate(header) if column == name]
        if not matches:
            unclaimed = (i for i, column in enumerate(header) if column not in wanted)
            matches = [i for i in unclaimed if header[i].strip() == name]
        if len(matches) > 1:
            raise InputError(f"{path}: the column '{name}' appears twice")
        if matches:
            places[name] = matches[0]
    return places


def _header(path: Path) -> tuple[str, ...]:
    with path.open(encoding="utf-8-sig", errors="surrogateescape", newline="") as file:
        header = next(filter(None, csv.reader(file, skipinitialspace=True)), [])
    try:
        ",".join(header).encode()
    except UnicodeEncodeError:
        raise InputError(f"{path}: the header is not UTF-8 text") from None
    return tuple(header)


class _EndedText:
    """Prepares the bytes of a CSV of n columns for Arrow, chunk by chunk.

    It drops spaces before a field's opening quote, which Arrow would read as part of the value, and
    appends a row of n + 1 fields. Arrow has to report that row as wrong: if it does not, a quote is
    still open.
    """

    def __init__(self, columns: int) -> None:
        self.last_row = "end of the table" + "," * columns
        self._rest = b""
        self._quotes = 0
        self._ended = False

    def __call__(self, chunk: Any) -> bytes:
        text = self._rest + bytes(chunk)
        if len(chunk):
            # Spaces and the quote after them may come in different chunks.
            end = max(0, text.rfind(b","), text.rfind(b"\n"), text.rfind(b"\r"))
            text, self._rest = text[:end], text[end:]
        elif self._ended:  # Arrow asks again after the end.
            return b""
        else:
            text, self._ended = text + b"\n" + self.last_row.encode(), True
        parts, place = [], 0
        if b' "' in text or b'\t"' in text:
            for spaces in SPACE_BEFORE_QUOTE.finditer(text):
                self._quotes += text.count(b'"', place, spaces.start())
                outside = self._quotes % 2 == 0  # Inside a field, quotes are doubled.
                parts.append(text[place : spaces.start() if outside else spaces.end()])
                place = spaces.end()
        self._quotes += text.count(b'"', place)
        return b"".join([*parts, text[place:]])


def _batches(path: Path, columns: int, places: dict[str, int]) -> Iterator[Any]:
    text = _EndedText(columns)
    wrong: list[str] = []

    def note(row: Any) -> str:
        wrong.append(row.text)
        return "skip" if row.text == text.last_row else "error"

    read = list(map(str, places.values()))
    rows = -1  # The header is read as a row: Arrow's way to skip it loses rows after some headers.
    try:
        reader = pa_csv.open_csv(
            pa.TransformInputStream(pa.OSFile(str(path)), text),
            pa_csv.ReadOptions(
                use_threads=False,  # With threads, Arrow does not count the rows.
                block_size=BLOCK,
                column_names=[str(place) for place in range(columns)],
            ),
            pa_csv.ParseOptions(newlines_in_values=True, invalid_row_handler=note),
            pa_csv.ConvertOptions(
                include_columns=read,
                column_types=dict.fromkeys(read, pa.dictionary(pa.int32(), pa.string())),
                null_values=[""],
                strings_can_be_null=True,
                quoted_strings_can_be_null=False,
            ),
        )
        for batch in reader:
            first = int(rows < 0)
            rows += batch.num_rows
            if batch.num_rows > first:
                yield pa.table(batch.columns, list(places)).slice(first)
    except pa.ArrowInvalid as error:
        quote_open = any(row != text.last_row and row.endswith(text.last_row) for row in wrong)
        match = ROW_ERROR.search(str(error))
        if "straddling" in str(error):
            limit = f"{BLOCK >> 20} MB; perhaps it opens a quote and never closes it"
            why = f"row {rows + 1} is longer than {limit}"
        elif match is None:
            why = str(error).splitlines()[0]
        elif quote_open:
            why = f"row {int(match[1]) - 1} opens a quote and never closes it"
        else:
            why = f"row {int(match[1]) - 1}: {match[2]}"
        raise InputError(f"{path}: {why}") from None
    if not wrong:
        raise InputError(f"{path}: row {rows} opens a quote and never closes it")
