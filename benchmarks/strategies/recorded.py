"""Published outcomes of rendered tests: one compact table a scenario, from which the emulators are made."""

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
GRAIN = 1e-4
"""Points are executed on a grid this fine, as a share of a variable's range, so few digits hold them without loss."""


@dataclass(frozen=True)
class Recorded:
    """Valid rendered tests of one scenario.

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
        return Recorded(self.space, self.points[chosen], self.kpi[chosen], self.failed[chosen], self.random[chosen], self.errors)


def path_of(scenario: str, folder: Path = DATA) -> Path:
    """The table of a scenario; InputError if there is none."""
    path = folder / f"{scenario}.csv.gz"
    if not path.is_file():
        raise InputError(f"{path}: no such file; make it with `python benchmarks/strategies/record.py --scenario {scenario}`")
    return path


def digest(scenario: str, folder: Path = DATA) -> str:
    """SHA-256 of a scenario's table; InputError if there is none."""
    return sha256(path_of(scenario, folder))


def on_grid(space: Space, points: Floats) -> Floats:
    """Points (n, d) with continuous variables rounded to `GRAIN` of their range; a point whose rounding breaks a constraint stays."""
    rounded = points.copy()
    for j, variable in enumerate(space.variables):
        if variable.kind == "continuous":
            rounded[:, j] = np.clip(np.round(points[:, j], _digits(variable.high - variable.low)), variable.low, variable.high)
    holds = space.constraints.holds(space.categorise(rounded))
    return np.where(holds[:, None], rounded, points)


def _digits(span: float) -> int:
    return max(0, -int(np.floor(np.log10(span * GRAIN))))


def write(table: pd.DataFrame, path: Path) -> None:
    """Write the rows: strategy, status, adj_ttc_s, failure and the scenario's variables; the same rows give the same bytes."""
    text = table.to_csv(index=False, lineterminator="\n", float_format="%.9g")
    write_bytes(path, gzip.compress(text.encode(), 9, mtime=0))


def read(scenario: str, space: Space, folder: Path = DATA) -> Recorded:
    """The recorded tests of a scenario; InputError if there are none or if one lies outside the space."""
    path = path_of(scenario, folder)
    table = pd.read_csv(path)
    table["test_id"] = [f"{path.name} row {row}" for row in range(len(table))]
    valid = table[table["status"] == "ok"]
    return Recorded(
        space,
        encode_tests(valid, space),
        valid["adj_ttc_s"].to_numpy(float),
        valid["failure"].to_numpy(bool),
        (valid["strategy"] == "random").to_numpy(),
        len(table) - len(valid),
    )
