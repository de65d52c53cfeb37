"""Tables of frames with times.

Each sequence becomes one row, with the categories that the rules of a space compute from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
    # The names of all sequences, and the number of each frame's sequence.
    named = pa.concat_arrays(names)
    if named.null_count:
        row = int(np.flatnonzero(named.is_null().to_numpy(zero_copy_only=False))[0])
        raise InputError(
            f"{path}: row {row + 1}: expected a sequence in column {space.sequence}, got nothing"
        )
    coded = named.dictionary_encode()
    distinct = tuple(map(str, coded.dictionary.to_pylist()))
    time_s, sequence = np.concatenate(times), coded.indices.to_numpy().astype(np.int64)
    if len(wrong := np.flatnonzero(~np.isfinite(time_s))):
        raise InputError(
            f"{path}: row {int(wrong[0]) + 1}: expected a time, as a number of seconds or a "
            "timestamp"
        )
    # The frames by sequence and time.
    order = np.lexsort((time_s, sequence))
    time_s, sequence = time_s[order], sequence[order]
    if len(twice := np.flatnonzero((np.diff(time_s) == 0) & (np.diff(sequence) == 0))):
        at = int(twice[0])
        raise InputError(
            f"{path}: two frames of {distinct[int(sequence[at])]} have the time {time_s[at]:.15g}"
        )
    points = space.points(Frames(categories[order], time_s, sequence, len(distinct)))
    columns = {}
    for variable, column in zip(space.variables, points.T, strict=True):
        places = pa.array(column, mask=column < 0)
        columns[variable.name] = pa.array(variable.labels, pa.string()).take(places)
    return pa.table(columns), distinct
