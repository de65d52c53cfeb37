"""Tables of points: CSV, parquet, and the images of COCO and YOLO data sets, as categories of a space."""

from __future__ import annotations

import difflib
import io
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.artefacts.files import read_bytes, read_json, write_bytes
from pipeline.core.space import Ints, Space, Variable
from pipeline.errors import InputError

MOST_CATEGORIES = 5000
"""Largest number of values of one variable: more usually means an identifier, or a measurement that needs cuts."""


def read_points(path: Path, space: Space, *, metadata: Path | None = None, empty: bool = False) -> Ints:
    """Category indices (n, d) of a table: CSV, parquet, COCO's JSON, or a folder of YOLO labels.

    Images of COCO or YOLO are points. Their conditions are columns of `metadata`, a CSV with `file_name`; without a column `objects`, that
    condition is the image's number of annotations. Other columns are ignored.

    Raises InputError that names the file, row and condition.
    """
    table = _table(path, metadata, wanted=space.names)
    if table.empty and not empty:
        raise InputError(f"{path}: expected points, got an empty table")
    try:
        return categorise(space, {str(name): _column(table[name]) for name in table.columns if name in space.names or len(table) == 0})
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def write_points(path: Path, space: Space, points: Ints) -> None:
    """Write (n, d) category indices as CSV; the header holds the variables' names, the cells the categories' names."""
    table = pd.DataFrame(space.names_of(points), columns=list(space.names))
    write_bytes(path, table.to_csv(index=False, lineterminator="\n").encode())


def categorise(space: Space, columns: Mapping[str, Sequence[Any]]) -> Ints:
    """Category indices (n, d) of a table's columns; ValueError that names a wrong value or a row that breaks a constraint."""
    if missing := [name for name in space.names if name not in columns]:
        raise ValueError(f"expected a column for each condition; there is none for {', '.join(missing)}, only {', '.join(columns)}")
    points = np.column_stack([categories_of(variable, columns[variable.name]) for variable in space.variables])
    if broken := space.constraints.first_broken(points):
        row, clause = broken
        where = ", ".join(f"{name} = {label}" for name, label in space.names_of(points[[row]])[0].items())
        raise ValueError(f"row {row + 1} breaks the constraint '{space.clause(clause)}': {where}")
    return points


def categories_of(variable: Variable, column: Sequence[Any]) -> Ints:
    """Category indices of (n,) values or names of categories; ValueError names the row, from 1, the expected and the actual value."""
    if variable.kind != "categorical":
        return _of_numbers(variable, column)
    if isinstance(column, np.ndarray):
        different, where = np.unique(column, return_inverse=True)
        if len(different) < len(column):
            try:
                return categories_of(variable, different)[where]
            except ValueError:
                column = column.tolist()  # Only to name the first wrong row.
    index = {label: i for i, label in enumerate(variable.values)}
    distinct = {value: next((index[text] for text in _spellings(value) if text in index), -1) for value in dict.fromkeys(column)}
    for value, category in distinct.items():
        if category < 0:
            row = list(column).index(value) if value == value else next(i for i, v in enumerate(column) if v != v)
            expected = _expected(variable, _shown(value))
            if len(distinct) > MOST_CATEGORIES:
                raise ValueError(
                    f"row {row + 1}: {variable.name} has {len(distinct):,} different values, as an identifier or a measurement has; "
                    f"expected {expected}, or give it an interval with cuts"
                )
            raise ValueError(f"row {row + 1}: {variable.name} must be {expected}, got {_shown(value)}")
    return np.array([distinct[value] for value in column], dtype=np.int64)


def _of_numbers(variable: Variable, column: Sequence[Any]) -> Ints:
    """As `categories_of`, for a variable with a range."""
    named = np.full(len(column), -1)
    numeric = isinstance(column, np.ndarray) and column.dtype.kind in "fiu"
    numbers = np.asarray(column, float) if numeric else np.empty(len(column))
    for row, value in enumerate(() if numeric else column):
        try:
            numbers[row] = float(value)
        except (TypeError, ValueError):
            known = isinstance(value, str) and value.strip() in variable.labels
            numbers[row] = variable.low if known else np.nan
            named[row] = variable.labels.index(value.strip()) if known else -1
    outside = ~((numbers >= variable.low) & (numbers <= variable.high))
    if outside.any():
        row = int(np.argmax(outside))
        expected = f"a number in [{variable.low:g}, {variable.high:g}] {variable.unit}".rstrip()
        raise ValueError(f"row {row + 1}: {variable.name} must be {expected}, got {_shown(column[row])}")
    return np.where(named >= 0, named, variable.categorise(numbers)).astype(np.int64)


def _expected(variable: Variable, wrong: str) -> str:
    close = difflib.get_close_matches(wrong.strip("'"), variable.values, n=1, cutoff=0.5)
    shown = variable.values if len(variable.values) <= 12 else (*variable.values[:6], "…")
    return f"one of {', '.join(shown)}" + (f" (did you mean '{close[0]}'?)" if close else "")


def _spellings(value: Any) -> Iterator[str]:
    """The spelling of a table's value in a space file: whole numbers without a point, truth values in small letters, others unchanged."""
    text = str(value).strip()
    yield text
    yield text.lower() if text.lower() in ("true", "false") else text
    try:
        if float(text).is_integer():
            yield str(int(float(text)))
    except (ValueError, OverflowError):
        return


def _shown(value: Any) -> str:
    if value is None or value != value:
        return "nothing"
    return repr(value) if isinstance(value, str) else f"{value:g}" if isinstance(value, float) else str(value)


def _column(series: pd.Series) -> Any:
    """A column as numbers if it holds only numbers, which is faster, else unchanged."""
    numbers = pd.to_numeric(series, errors="coerce")
    return numbers.to_numpy(float) if numbers.notna().all() and series.dtype != bool else series.tolist()


def _table(path: Path, metadata: Path | None, wanted: tuple[str, ...]) -> pd.DataFrame:
    if path.is_dir() or path.suffix == ".json":
        counts = _yolo(path) if path.is_dir() else _coco(path)
        if metadata is None:
            raise InputError(f"{path}: the conditions of images are in a CSV with a column file_name; name it by --metadata")
        return _joined(path, counts, _read(metadata), metadata)
    return _read(path)


def _read(path: Path) -> pd.DataFrame:
    if not path.exists():
        raise InputError(f"{path}: expected a CSV or parquet table, got no such file")
    data = io.BytesIO(read_bytes(path))
    try:
        if path.suffix == ".parquet":
            return pd.read_parquet(data)
        return pd.read_csv(data, skipinitialspace=True, keep_default_na=False, na_values=[""], dtype=object)
    except pd.errors.EmptyDataError:
        return pd.DataFrame()
    except (ValueError, OSError) as error:
        raise InputError(f"{path}: expected a CSV or parquet table, got {str(error).splitlines()[0]}") from error


def _coco(path: Path) -> dict[str, int]:
    plain = read_json(path)
    try:
        names = {image["id"]: str(image["file_name"]) for image in plain["images"]}
        counts = dict.fromkeys(names.values(), 0)
        for annotation in plain["annotations"]:
            counts[names[annotation["image_id"]]] += 1
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: expected COCO's images and annotations, got {error!r}") from error
    return counts


def _yolo(path: Path) -> dict[str, int]:
    labels = sorted((path / "labels").rglob("*.txt")) or sorted(path.rglob("*.txt"))
    if not labels:
        raise InputError(f"{path}: expected a folder of YOLO labels (*.txt), got none")
    root = path / "labels" if labels[0].is_relative_to(path / "labels") else path
    names = {label: label.relative_to(root).with_suffix("").as_posix() for label in labels}
    return {name: sum(bool(line.strip()) for line in label.read_text().splitlines()) for label, name in names.items()}


def _joined(path: Path, counts: dict[str, int], table: pd.DataFrame, metadata: Path) -> pd.DataFrame:
    """Rows of the metadata for each image, in the images' order: matched by path, else by file name if that is unambiguous."""
    if "file_name" not in table:
        raise InputError(f"{metadata}: expected a column file_name, got {', '.join(map(str, table.columns))}")
    keys = [Path(key) for key in table["file_name"].astype(str)]
    whole = {key.with_suffix("").as_posix(): i for i, key in reversed(list(enumerate(keys)))}
    alone = {key.stem: i for i, key in reversed(list(enumerate(keys)))}
    shared = {stem for stem, number in Counter(Path(name).stem for name in counts).items() if number > 1}
    shared |= {stem for stem, number in Counter(Path(name).stem for name in whole).items() if number > 1}
    rows = []
    for name in counts:
        image = Path(name).with_suffix("")
        row = whole.get(image.as_posix(), None if image.stem in shared else alone.get(image.stem))
        if row is None:
            several = f", and several images are called {image.stem}" if image.stem in shared else ""
            raise InputError(f"{metadata}: expected a row for every image of {path}, there is none for {name}{several}")
        rows.append(row)
    joined = table.iloc[rows].reset_index(drop=True)
    return joined if "objects" in joined else joined.assign(objects=list(counts.values()))
