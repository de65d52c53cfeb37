"""Published outcomes of rendered campaigns: a compact table each, in a folder for each study."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.artefacts.files import sha256, write_bytes
from pipeline.artefacts.points import encode_tests
from pipeline.core.space import Floats, Space
from pipeline.errors import InputError

DATA = Path(__file__).parent / "data"
DENSE = DATA / "default"
"""The campaigns from which the emulators are made."""
JUDGED = ("failure", "failure_mode", "cause")
"""Columns of a table after status and adj_ttc_s, as in tests.parquet; the scenario's variables follow."""
GRAIN = 1e-4
"""Points are executed on a grid this fine, as a share of a variable's range, so few digits hold them without loss."""


@dataclass(frozen=True)
class Recorded:
    """Valid rendered tests of one scenario, of all strategies.

    points: (n, d). kpi: (n,) seconds. failed, random: (n,) whether a test failed, and whether its point was drawn at random. errors:
    number of tests left out because they ended in an error.
    """

    space: Space
    points: Floats
    kpi: Floats
    failed: NDArray[np.bool_]
    random: NDArray[np.bool_]
    errors: int

    def rows(self, chosen: NDArray[np.int64] | NDArray[np.bool_]) -> Recorded:
        """Some of the tests."""
        return Recorded(
            self.space,
            self.points[chosen],
            self.kpi[chosen],
            self.failed[chosen],
            self.random[chosen],
            self.errors,
        )


def path_of(scenario: str, strategy: str, folder: Path) -> Path:
    """The table of a campaign."""
    return folder / f"{scenario}-{strategy}.csv.gz"


def paths_of(scenario: str, folder: Path = DENSE) -> dict[str, Path]:
    """The tables of a scenario by strategy; InputError if there is none."""
    paths = {
        path.name.removesuffix(".csv.gz").partition("-")[2]: path
        for path in sorted(folder.glob(f"{scenario}-*.csv.gz"))
    }
    if not paths:
        command = (
            f"python benchmarks/strategies/record.py --study {folder.name} --scenario {scenario}"
        )
        raise InputError(f"{folder}: there is no table of {scenario}; make it with `{command}`")
    return paths


def digest(scenario: str, folder: Path = DENSE) -> str:
    """SHA-256 of each of a scenario's tables, joined; InputError if there is none."""
    return "".join(map(sha256, paths_of(scenario, folder).values()))


def on_grid(space: Space, points: Floats) -> Floats:
    """Points (n, d) with continuous variables rounded to `GRAIN` of their range; a point whose rounding changes a category stays."""
    rounded = points.copy()
    for j, variable in enumerate(space.variables):
        if variable.kind == "continuous":
            rounded[:, j] = np.clip(
                np.round(points[:, j], _digits(variable.high - variable.low)),
                variable.low,
                variable.high,
            )
    same = (space.categorise(rounded) == space.categorise(points)).all(axis=1)
    return np.where(same[:, None], rounded, points)


def _digits(span: float) -> int:
    return max(0, -int(np.floor(np.log10(span * GRAIN))))


def write(table: pd.DataFrame, path: Path) -> None:
    """Write the rows of a campaign in order; the same rows give the same bytes."""
    text = table.to_csv(index=False, lineterminator="\n", float_format="%.9g")
    write_bytes(path, gzip.compress(text.encode(), 9, mtime=0))


def campaign(path: Path, space: Space) -> tuple[pd.DataFrame, Floats]:
    """All tests of a table in order, and their points (n, d); InputError if one lies outside the space."""
    table = pd.read_csv(path)
    table["test_id"] = [f"{path.name} row {row}" for row in range(len(table))]
    return table, encode_tests(table, space)


def read(scenario: str, space: Space, folder: Path = DENSE) -> Recorded:
    """The recorded tests of a scenario; InputError if there are none or if one lies outside the space."""
    tables, points, random = [], [], []
    for strategy, path in paths_of(scenario, folder).items():
        table, own = campaign(path, space)
        tables.append(table)
        points.append(own)
        random.append(np.full(len(table), strategy == "random"))
    table, valid = pd.concat(tables), pd.concat(tables)["status"].to_numpy() == "ok"
    return Recorded(
        space,
        np.concatenate(points)[valid],
        table["adj_ttc_s"].to_numpy(float)[valid],
        table["failure"].to_numpy(bool)[valid],
        np.concatenate(random)[valid],
        int((~valid).sum()),
    )
