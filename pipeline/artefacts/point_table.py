"""Tables of points: CSV, parquet, and the images of data sets, as categories of a space."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.artefacts.image_sets import read_images
from pipeline.artefacts.table_categories import Fault, categories_of
from pipeline.artefacts.table_file import read_table, write_table
from pipeline.core.constraints import Bools
from pipeline.core.coverage.partial import broken_clauses
from pipeline.core.space import Ints, Space
from pipeline.errors import InputError


@dataclass(frozen=True)
class PointTable:
    """The points of a table.

    categories: (n, d) indices of all rows, -1 where a row has no category. faults: the causes of these, then the constraints that rows
    break. keeps: (n,) rows that break no constraint. images: names of the rows, if they are images. unused: rows of the metadata that
    belong to no image.
    """

    path: Path
    categories: Ints
    faults: tuple[Fault, ...]
    keeps: Bools
    images: tuple[str, ...] = ()
    unused: int = 0

    @property
    def points(self) -> Ints:
        """The rows that count: those that keep the constraints; InputError if there are rows and none counts."""
        if len(self.keeps) and not self.keeps.any():
            raise InputError(f"{self.path}: every row breaks a constraint; {self.told(self.faults[-1])}")
        return self.categories[self.keeps]

    def strict(self) -> Ints:
        """All rows; InputError that names the first imperfect one."""
        if self.faults:
            raise InputError(f"{self.path}: {self.told(self.faults[0])}")
        return self.categories

    def complete(self) -> Ints:
        """All rows, also those that break a constraint; InputError that names the first row without a category for each condition."""
        if faults := [fault for fault in self.faults if not fault.left_out]:
            raise InputError(f"{self.path}: {self.told(faults[0])}")
        return self.categories

    def told(self, fault: Fault) -> str:
        """A fault with its first row."""
        where = f"image {self.images[fault.row]}" if self.images else f"row {fault.row + 1}"
        return f"{where}{' ' if fault.left_out else ': '}{fault.text}"


def read_points(path: Path, space: Space, *, metadata: Path | None = None, empty: bool = False) -> PointTable:
    """The points of a table: CSV, parquet, JSON of COCO, BDD100K or OpenLABEL, or a folder of YOLO, KITTI or nuScenes.

    Images are points. Their conditions are columns of `metadata`, a table with `file_name`, or what the data set itself says, such as
    `objects`, the number of annotations. Other columns are ignored. empty: whether a table without rows is allowed.

    Raises InputError that names the file and what is wrong with the table as a whole.
    """
    names: tuple[str, ...] = ()
    unused = 0
    if path.is_dir() or path.suffix.lower() == ".json":
        images = read_images(path, metadata, space)
        table, names, unused = images.table, images.names, images.unused
    elif metadata is not None:
        raise InputError(f"{path}: --metadata goes with COCO's JSON and folders of YOLO labels; a table has the conditions as columns")
    else:
        table = read_table(path, space.names)
    if not table.header or not (table.rows or empty):
        raise InputError(f"{path}: expected points, got an empty table")
    if missing := [name for name in space.names if name not in table.columns]:
        where = path if metadata is None else metadata
        known = ", ".join(table.header)
        raise InputError(f"{where}: expected a column for each condition; there is none for {', '.join(missing)}, only {known}")
    try:
        found = [categories_of(variable, table.columns[variable.name]) for variable in space.variables]
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
    points = np.column_stack([categories for categories, _ in found])
    broken = broken_clauses(space.constraints, points)
    faults = [fault for _, several in found for fault in several] + _breaking(space, points, broken)
    return PointTable(path, points, tuple(faults), broken < 0, names, unused)


def _breaking(space: Space, points: Ints, broken: Ints) -> list[Fault]:
    """A fault for each clause that rows break, in the order of the first row; broken: as `broken_clauses` gives it."""
    faults = []
    for clause in np.unique(broken[broken >= 0]):
        rows = np.flatnonzero(broken == clause)
        which = f"constraint '{space.clause(clause)}'" if clause < len(space.constraints.clauses) else "constraints together"
        known = [(v, c) for v, c in zip(space.variables, points[rows[0]], strict=True) if c >= 0]
        where = ", ".join(f"{variable.name} = {variable.labels[category]}" for variable, category in known)
        faults.append(Fault(f"breaks the {which}: {where}", int(rows[0]), len(rows), left_out=True))
    return sorted(faults, key=lambda fault: fault.row)


def write_points(path: Path, space: Space, points: Ints) -> None:
    """Write (n, d) category indices as CSV or parquet; the header holds the variables' names, the cells the categories' names."""
    write_table(path, space.names, [list(names.values()) for names in space.names_of(points)])
