"""Tables of points: CSV, parquet, and the images of data sets, as categories of a space."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.artefacts.data_set import IMAGE_SETS
from pipeline.artefacts.image_sets import read_images
from pipeline.artefacts.sequence_table import sequences
from pipeline.artefacts.table_categories import Fault, Meanings
from pipeline.artefacts.table_file import open_table, write_table
from pipeline.core.constraints import Bools
from pipeline.core.coverage.partial import broken_clauses
from pipeline.core.sequences import SequenceSpace
from pipeline.core.space import Ints, Space
from pipeline.errors import InputError


class PointTable:
    """The points of a table, which are read once, batch by batch.

    Attributes:
        rows: number of rows so far.
        points: number of these that keep the constraints.
        partial: number of these points without a category for some condition.
        images: names of the rows, if they are images or sequences.
        kind: what the names are of, "image" or "sequence".
        unused: rows of the metadata that belong to no image.
    """

    images: tuple[str, ...] = ()
    kind = "image"
    unused = 0

    def __init__(
        self, path: Path, space: Space, batches: Iterator[Any], empty: bool = False
    ) -> None:
        self.path, self._space, self._batches, self._empty = path, space, batches, empty
        self.rows = self.points = self.partial = 0
        self._meanings = [Meanings(variable) for variable in space.variables]
        self._broken: dict[int, Fault] = {}

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Why rows so far have no category, then the constraints that they break."""
        broken = sorted(self._broken.values(), key=_row)
        return tuple([fault for column in self._meanings for fault in column.faults()] + broken)

    def counting(self, strict: bool = False) -> Iterator[Ints]:
        """(n, d) category indices of the rows that count, batch by batch.

        These are the rows that keep the constraints; -1 where there is no category.

        Raises:
            InputError: after the last batch: if there are rows and none counts, and, if strict, for
                an imperfect row.
        """
        for rows, keeps in self._read():
            yield rows if keeps.all() else rows[keeps]
        if strict and (faults := self.faults):
            raise InputError(f"{self.path}: {self.told(min(faults, key=_row))}")
        if self.rows and not self.points:
            raise InputError(
                f"{self.path}: every row breaks a constraint; {self.told(self.faults[-1])}"
            )

    def strict(self) -> Ints:
        """All rows; InputError that names the first imperfect one."""
        return self._together(self.counting(strict=True))

    def complete(self) -> Ints:
        """All rows, also those that break a constraint.

        Raises:
            InputError: naming the first row without a category for each condition.
        """
        rows = self._together(rows for rows, _ in self._read())
        if faults := [fault for fault in self.faults if not fault.left_out]:
            raise InputError(f"{self.path}: {self.told(min(faults, key=_row))}")
        return rows

    def known(self) -> Ints:
        """All rows, -1 where there is no category."""
        return self._together(rows for rows, _ in self._read())

    def told(self, fault: Fault) -> str:
        """A fault with its first row."""
        where = f"{self.kind} {self.images[fault.row]}" if self.images else f"row {fault.row + 1}"
        return f"{where}{' ' if fault.left_out else ': '}{fault.text}"

    def _together(self, batches: Iterator[Ints]) -> Ints:
        return np.concatenate([np.zeros((0, len(self._space)), np.int64), *batches])

    def _read(self) -> Iterator[tuple[Ints, Bools]]:
        for batch in self._batches:
            try:
                rows = np.empty((batch.num_rows, len(self._meanings)), np.int64)
                for place, column in enumerate(self._meanings):
                    rows[:, place] = column.categories(batch.column(column.variable.name))
            except ValueError as error:
                raise InputError(f"{self.path}: {error}") from error
            broken = broken_clauses(self._space.constraints, rows)
            keeps = broken < 0
            for clause in map(int, np.unique(broken[broken >= 0])):
                breaking = np.flatnonzero(broken == clause)
                fault = self._broken.get(clause)
                if fault is None:
                    first = int(breaking[0])
                    space, which = self._space, "constraints together"
                    if clause < len(space.constraints.clauses):
                        which = f"constraint '{space.clause(clause)}'"
                    values = []
                    for variable, category in zip(space.variables, rows[first], strict=True):
                        if category >= 0:
                            values.append(f"{variable.name} = {variable.labels[category]}")
                    text = f"breaks the {which}: {', '.join(values)}"
                    fault = Fault(text, self.rows + first, 0, left_out=True)
                self._broken[clause] = replace(fault, rows=fault.rows + len(breaking))
            self.rows += len(rows)
            self.points += int(keeps.sum())
            self.partial += int(((rows < 0).any(axis=1) & keeps).sum())
            yield rows, keeps
        if not (self.rows or self._empty):
            raise InputError(f"{self.path}: expected points, got an empty table")


_row = attrgetter("row")


def read_points(
    path: Path, space: Space, *, metadata: Path | None = None, empty: bool = False
) -> PointTable:
    """The points of a table: CSV, parquet, JSON of COCO, BDD100K or OpenLABEL, or a folder of YOLO,
    KITTI, nuScenes or OpenLABEL.

    Images are points. Their conditions are columns of `metadata`, a table with `file_name`, or what
    the data set itself says, such as `objects`, the number of annotations. Of a space of sequences,
    a table may hold frames. Other columns are ignored.

    Args:
        empty: whether a table without rows is allowed.

    Raises:
        InputError: here or from the batches, that names the file and what is wrong with the table
            as a whole.
    """
    if path.is_dir() or path.suffix.lower() == ".json":
        images = read_images(path, metadata, space)
        _check_columns(
            metadata or path, space.names, list(images.table.columns), images.table.header
        )
        table = PointTable(path, space, iter([pa.table(images.table.columns)]), empty)
        table.images, table.unused = images.names, images.unused
        return table
    if metadata is not None:
        raise InputError(
            f"{path}: --metadata goes with {IMAGE_SETS}; a table has the conditions as columns"
        )
    if isinstance(space, SequenceSpace) and len(open_table(path, space.names).columns) < len(
        space.names
    ):
        return _sequences(path, space, empty)
    return PointTable(path, space, _opened(path, space.names), empty)


def _sequences(path: Path, space: SequenceSpace, empty: bool) -> PointTable:
    """The sequences of a table of frames.

    Frames that break no rule count, whatever else is wrong with them.
    """
    columns = [*space.frames.names, space.time, *([space.sequence] if space.sequence else [])]

    def categories(frames: Space, batches: Iterator[Any]) -> Ints:
        return PointTable(path, frames, batches, empty).known()

    points, names = sequences(path, space, _opened(path, columns), categories)
    table = PointTable(path, space, iter([points]), empty)
    table.images, table.kind = names, "sequence"
    return table


def _opened(path: Path, columns: Sequence[str]) -> Iterator[Any]:
    """The batches of a table; InputError if it lacks one of the columns."""
    opened = open_table(path, columns)
    if not opened.header:
        raise InputError(f"{path}: expected points, got an empty table")
    _check_columns(path, columns, opened.columns, opened.header)
    return opened.batches


def _check_columns(
    path: Path, wanted: Sequence[str], columns: Sequence[str], header: Sequence[str]
) -> None:
    if missing := [name for name in wanted if name not in columns]:
        raise InputError(
            f"{path}: expected a column for each condition; there is none for "
            f"{', '.join(missing)}, only {', '.join(header)}"
        )


def write_points(path: Path, space: Space, points: Ints) -> None:
    """Write (n, d) category indices as CSV or parquet.

    The header holds the variables' names, the cells the categories' names.
    """
    write_table(path, space.names, [list(names.values()) for names in space.names_of(points)])
