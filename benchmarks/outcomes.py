"""Published outcomes of a study: a row for each held-out test and a column for each version (0 passed, 1 failed, 2 ended in an error)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.artefacts.tables import read_tests

TEST = ["scenario", "index", "animation", "blueprint"]
PASSED, FAILED, ERROR = 0, 1, 2


def of_study(study: Path, seed: int) -> pd.DataFrame:
    """The outcomes of a finished study. SystemExit if its searches have another seed."""
    parts = [read_tests(path) for path in sorted(study.glob("held_out/*/*/*/*/tests.parquet"))]
    searched = {path.parent.name for path in study.glob("campaigns/*/*/base/*/tests.parquet")}
    if not parts or searched != {str(seed)}:
        raise SystemExit(f"{study}: expected a finished study whose searches have seed {seed}, found {sorted(searched) or 'none'}")
    tests = pd.concat(parts, ignore_index=True)
    tests["outcome"] = np.where(tests["status"] != "ok", ERROR, tests["failure"].astype(int))
    table = tests.pivot(index=TEST, columns="version", values="outcome")
    if table.isna().to_numpy().any():
        raise SystemExit(f"{study}: the versions were not tested on the same tests; finish the study with ./run")
    return table.astype(int).reset_index()


def write(outcomes: pd.DataFrame, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    outcomes.to_csv(path, index=False, compression={"method": "gzip", "mtime": 0})


def valid(outcomes: pd.DataFrame) -> pd.DataFrame:
    """Whether each version failed, (tests, versions), of the tests that no version ended in an error."""
    versions = outcomes.drop(columns=TEST)
    return versions[(versions != ERROR).all(axis=1)] == FAILED


def failures(outcomes: pd.DataFrame) -> dict[str, int]:
    """Failures of each version."""
    return {str(name): int(count) for name, count in valid(outcomes).sum().items()}
