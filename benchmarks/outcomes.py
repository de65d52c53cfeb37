"""Published outcomes of a study: a row for each held-out test and a column for each version (0 passed, 1 failed, 2 ended in an error)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.stats import ttest_1samp

from pipeline.artefacts.folders import Folders
from pipeline.artefacts.tables import read_all_tests
from pipeline.config.schema import Config
from pipeline.core.statistics import TOLERANCE, mean_interval

TEST = ["scenario", "index", "animation", "blueprint"]
PASSED, FAILED, ERROR = 0, 1, 2


def of_study(config: Config, root: Path = Path()) -> pd.DataFrame:
    """The outcomes of a finished study. root: the folder that it was executed in. SystemExit if it is unfinished."""
    tests = held_out_tests(config, root)
    tests["outcome"] = np.where(tests["status"] != "ok", ERROR, tests["failure"].astype(int))
    table = tests.pivot(index=TEST, columns="version", values="outcome")
    if table.isna().to_numpy().any():
        raise SystemExit(
            f"{Folders(config).root}: expected the same tests of every version, got others; finish the study with ./run"
        )
    return table.astype(int).reset_index()


def held_out_tests(config: Config, root: Path = Path()) -> pd.DataFrame:
    """The held-out tests of all versions that a config names: its folder may also hold those of earlier configs."""
    paths = [root / path for path in Folders(config).held_out("tests.parquet")]
    for path in paths:
        if not path.exists():
            raise SystemExit(
                f"{path}: expected the tests of a finished study, got no file; finish the study with ./run"
            )
    return read_all_tests(paths)


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


def mean_difference(differences: ArrayLike) -> str:
    """`-2.0 (-27.4 to +23.4)`: the mean of (n,) differences, one per search, with Student's interval.

    One search, or several that differ equally, tell nothing of the spread, so they have no interval.
    """
    values = np.asarray(differences, float)
    low, high = mean_interval(values)
    return f"{values.mean():+.1f}" + (
        f" ({low:+.1f} to {high:+.1f})" if np.ptp(values) > TOLERANCE else ""
    )


def smallest_p(differences: Mapping[str, ArrayLike]) -> str:
    """`by Student's t-test: 0.038 (25 %), by Holm 0.151`: which differences, (n,), one per search, are least likely to be chance.

    Holm's method multiplies the smallest p-value by their number.
    """
    p_values = {name: student_p(found) for name, found in differences.items()}
    name, smallest = min(p_values.items(), key=lambda item: item[1])
    return f"by Student's t-test: {p_text(smallest)} ({name}), by Holm {p_text(min(1.0, len(p_values) * smallest))}"


def student_p(differences: ArrayLike) -> float:
    """The p-value of (n,) differences, one per search. 1 for one search, or several that differ equally: nothing tells their spread."""
    values = np.asarray(differences, float)
    return float(ttest_1samp(values, 0).pvalue) if np.ptp(values) > TOLERANCE else 1.0


def p_text(p_value: float) -> str:
    """A p-value in a table: `0.035`, `< 0.001`."""
    return "< 0.001" if p_value < 0.001 else f"{p_value:.3f}"
