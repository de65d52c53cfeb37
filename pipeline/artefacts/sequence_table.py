"""Tables of frames with times.

Each sequence becomes one row, with the categories that the rules of a space compute from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.artefacts.table_categories import numbers_of
from pipeline.core.sequences import Frames, SequenceSpace
from pipeline.core.space import Ints, Space
from pipeline.errors import InputError

WHOLE = "the table"
"""Name of the only sequence of a table without a column of sequences."""
Rows = Callable[[Space, Iterator[Any]], Ints]
"""Reads the categories of all frames, (n, d), from batches of a table."""


def sequences(
    path: Path, space: SequenceSpace, batches: Iterator[Any], rows: Rows
) -> tuple[Any, tuple[str, ...]]:
    """A table of the names of each sequence's categories, null for an unknown one, and the
    sequences' names in the order of the table.

    Raises:
        InputError: naming the file: for a frame without a time or a sequence, and for two frames of
            one sequence at the same time.
    """
    times, names = [np.zeros(0)], [pa.array([], pa.string())]

    def noted() -> Iterator[Any]:
        for batch in batches:
            try:
                times.append(numbers_of(space.time, batch.column(space.time)))
            except ValueError as error:
                raise InputError(f"{path}: {error}") from error
            if space.sequence is None:
                names.append(pa.array([WHOLE] * batch.num_rows, pa.string()))
            else:
                column = batch.column(space.sequence).cast(pa.string())
                names.append(column.combine_chunks())
            yield batch

    categories = rows(space.frames, noted())
    distinct, sequence = _numbered(path, space, pa.concat_arrays(names))
    unordered = Frames(categories, np.concatenate(times), sequence, len(distinct))
    points = space.points(_in_order(path, distinct, unordered))
    columns = {}
    for variable, column in zip(space.variables, points.T, strict=True):
        places = pa.array(column, mask=column < 0)
        columns[variable.name] = pa.array(variable.labels, pa.string()).take(places)
    return pa.table(columns), distinct


def _numbered(path: Path, space: SequenceSpace, names: Any) -> tuple[tuple[str, ...], Ints]:
    """The names of all sequences and the number of each frame's sequence."""
    if names.null_count:
        row = int(np.flatnonzero(names.is_null().to_numpy(zero_copy_only=False))[0])
        raise InputError(
            f"{path}: row {row + 1}: expected a sequence in column {space.sequence}, got nothing"
        )
    coded = names.dictionary_encode()
    return tuple(map(str, coded.dictionary.to_pylist())), coded.indices.to_numpy().astype(np.int64)


def _in_order(path: Path, names: Sequence[str], frames: Frames) -> Frames:
    if len(wrong := np.flatnonzero(~np.isfinite(frames.time_s))):
        raise InputError(
            f"{path}: row {int(wrong[0]) + 1}: expected a time, as a number of seconds or a "
            "timestamp"
        )
    order = np.lexsort((frames.time_s, frames.sequence))
    time_s, sequence = frames.time_s[order], frames.sequence[order]
    twice = np.flatnonzero((np.diff(time_s) == 0) & (np.diff(sequence) == 0))
    if len(twice):
        at = int(twice[0])
        raise InputError(
            f"{path}: two frames of {names[int(sequence[at])]} have the time {time_s[at]:.15g}"
        )
    return Frames(frames.categories[order], time_s, sequence, frames.count)
