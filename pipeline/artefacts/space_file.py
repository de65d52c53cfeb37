"""Space files: operating conditions and their constraints in YAML, and the tables of points that are scored against them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from pipeline.artefacts.files import read_json, write_bytes
from pipeline.core.coverage.conditions import MOST_CATEGORIES, Condition, OperatingSpace
from pipeline.core.coverage.projection import HEAVIEST
from pipeline.core.names import nearest
from pipeline.core.space import Ints
from pipeline.errors import InputError

KEYS = ("values", "interval", "cuts", "cyclic", "unit", "weights")
EXAMPLE = "weather: {values: [sunny, rainy], weights: {rainy: 3}} or fog: {interval: [0, 100], cuts: [20, 50]}"


def read_space_file(path: Path) -> OperatingSpace:
    """Read a space file.

    Raises InputError that names the file and the key: for a missing, wrong or unknown one, and for constraints that contradict each other,
    with as few clauses as are needed for that.
    """
    try:
        plain = yaml.safe_load(path.read_text())
    except OSError as error:
        raise InputError(f"{path}: expected a space file, got {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: no YAML ({str(error).splitlines()[0]})") from error
    try:
        return _space(plain)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def _space(plain: Any) -> OperatingSpace:
    if not isinstance(plain, Mapping) or not isinstance(plain.get("variables"), Mapping) or not plain["variables"]:
        raise ValueError("expected a mapping with 'variables' and perhaps 'constraints'")
    for key in plain:
        if key not in ("variables", "constraints"):
            raise ValueError(f"unknown key '{key}'{nearest(str(key), ['variables', 'constraints'])}")
    conditions = tuple(_condition(str(name), body) for name, body in plain["variables"].items())
    clauses = plain.get("constraints") or []
    if not isinstance(clauses, list) or not all(isinstance(clause, list) for clause in clauses):
        raise ValueError("constraints: expected a list of clauses, each a list such as [lanes = 2, current_lane != 2]")
    space = OperatingSpace(conditions, tuple(tuple(str(literal) for literal in clause) for clause in clauses))
    if core := space.constraints.contradiction():
        listed = "; ".join(f"[{', '.join(space.clauses[i])}]" for i in core)
        raise ValueError(f"constraints: these contradict each other, so that no point is left: {listed}")
    return space


def _condition(name: str, body: Any) -> Condition:
    key = f"variables.{name}"
    if not isinstance(body, Mapping):
        raise ValueError(f"{key}: expected values or an interval, as in {EXAMPLE}; got {body!r}")
    for known in body:
        if known not in KEYS:
            raise ValueError(f"unknown key '{key}.{known}'{nearest(str(known), KEYS)}")
    if ("values" in body) == ("interval" in body):
        raise ValueError(f"{key}: expected either values or an interval, as in {EXAMPLE}")
    unit, cyclic = str(body.get("unit", "")), body.get("cyclic", False)
    if "values" in body:
        condition = Condition(name, values=_values(key, body["values"]), unit=unit)
        if "cuts" in body or cyclic:
            raise ValueError(f"{key}: cuts and cyclic go with an interval, not with values")
    else:
        interval = _numbers(f"{key}.interval", body["interval"])
        cuts = _numbers(f"{key}.cuts", body.get("cuts", []))
        if len(interval) != 2 or interval[0] >= interval[1]:
            raise ValueError(f"{key}.interval: expected two numbers, the smaller first, got {body['interval']}")
        if any(a >= b for a, b in pairwise((interval[0], *cuts, interval[1]))):
            raise ValueError(f"{key}.cuts: expected rising numbers inside {list(interval)}, got {body.get('cuts')}")
        if cyclic and len(cuts) == 1:
            raise ValueError(f"{key}.cuts: a cyclic interval needs no cut or at least two, got {body.get('cuts')}")
        condition = Condition(name, interval=(interval[0], interval[1]), cuts=cuts, cyclic=bool(cyclic), unit=unit)
    return replace(condition, weights=_weights(f"{key}.weights", body.get("weights"), condition.labels))


def _values(key: str, plain: Any) -> tuple[str, ...]:
    if not isinstance(plain, list) or not plain:
        raise ValueError(f"{key}.values: expected a list of names, got {plain!r}")
    values = tuple(("true" if v else "false") if isinstance(v, bool) else str(v).strip() for v in plain)
    if len(values) > MOST_CATEGORIES:
        raise ValueError(
            f"{key}.values: expected at most {MOST_CATEGORIES:,} names, got {len(values):,}; a measurement needs an interval with cuts"
        )
    if len(set(values)) != len(values):
        twice = next(value for value in values if values.count(value) > 1)
        raise ValueError(f"{key}.values: '{twice}' is there twice")
    return values


def _numbers(key: str, plain: Any) -> tuple[float, ...]:
    if not isinstance(plain, list) or not all(isinstance(v, int | float) and not isinstance(v, bool) and np.isfinite(v) for v in plain):
        raise ValueError(f"{key}: expected a list of numbers, got {plain!r}")
    return tuple(float(v) for v in plain)


def _weights(key: str, plain: Any, labels: tuple[str, ...]) -> tuple[int, ...]:
    """One weight a category, 1 where none is given."""
    if plain is None:
        return (1,) * len(labels)
    if isinstance(plain, list):
        if len(plain) != len(labels):
            raise ValueError(f"{key}: expected {len(labels)} numbers, one a category, got {len(plain)}")
        plain = dict(zip(labels, plain, strict=True))
    if not isinstance(plain, Mapping):
        raise ValueError(f"{key}: expected a weight for each category, got {plain!r}")
    named = {("true" if k else "false") if isinstance(k, bool) else str(k).strip(): weight for k, weight in plain.items()}
    for name, weight in named.items():
        if name not in labels:
            raise ValueError(f"{key}: there is no category '{name}'{nearest(name, labels)}")
        if not isinstance(weight, int) or isinstance(weight, bool) or not 0 <= weight <= HEAVIEST:
            raise ValueError(f"{key}.{name}: expected a whole number from 0 to {HEAVIEST}, got {weight!r}")
    return tuple(named.get(label, 1) for label in labels)


def read_points(path: Path, space: OperatingSpace, *, metadata: Path | None = None, empty: bool = False) -> Ints:
    """(n, d) category indices of a table: CSV, parquet, COCO's JSON, or a folder of YOLO labels.

    Images of COCO or YOLO are points whose conditions are columns of `metadata`, a CSV with `file_name`; a condition `objects` without a
    column is their number of annotations. Columns that are no condition are ignored.

    Raises InputError that names the file, row and condition.
    """
    table = _table(path, metadata, wanted=space.names)
    if table.empty and not empty:
        raise InputError(f"{path}: expected points, got an empty table")
    try:
        return space.categorise({str(name): _column(table[name]) for name in table.columns if name in space.names or len(table) == 0})
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def _column(series: pd.Series) -> Any:
    """A column as numbers where it has nothing else, which is quicker, else as it is."""
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
    try:
        if path.suffix == ".parquet":
            return pd.read_parquet(path)
        return pd.read_csv(path, skipinitialspace=True, keep_default_na=False, na_values=[""], dtype=object)
    except FileNotFoundError as error:
        raise InputError(f"{path}: expected a CSV or parquet table, got no such file") from error
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
    """Rows of the metadata for each image, in the images' order: by its path, else by its name alone where that says which one is meant."""
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


def write_points(path: Path, space: OperatingSpace, points: Ints) -> None:
    """Write points as CSV; its header is the conditions' names, its cells the names of their categories."""
    table = pd.DataFrame(space.decode(points), columns=list(space.names))
    write_bytes(path, table.to_csv(index=False, lineterminator="\n").encode())
