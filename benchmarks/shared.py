"""What several benchmarks need: outcomes of studies, differences between searches, Markdown tables.

The outcomes of a study are a table: a row for each held-out test and a column for each version,
0 if it passed, 1 if it failed, 2 if the test ended in an error.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.stats import ttest_1samp

from pipeline.artefacts.folders import Folders
from pipeline.artefacts.tables import read_all_tests
from pipeline.config.schema import Config
from pipeline.core.statistics import TOLERANCE, mean_interval

RESULTS = Path("docs/results")
TEST = ["scenario", "index", "animation", "blueprint"]
"""The columns that identify a held-out test."""
PASSED, FAILED, ERROR = 0, 1, 2


def of_study(config: Config, root: Path = Path()) -> pd.DataFrame:
    """The outcomes of a finished study.

    Args:
        config: The study; its folder may also hold tests of versions that other configs made.
        root: The folder in which it was executed.

    Raises:
        SystemExit: The study is unfinished.
    """
    paths = [root / path for path in Folders(config).held_out("tests.parquet")]
    for path in paths:
        if not path.exists():
            raise SystemExit(
                f"{path}: expected the tests of a finished study, got no file; "
                "finish the study with ./run"
            )
    tests = read_all_tests(paths)
    tests["outcome"] = np.where(tests["status"] != "ok", ERROR, tests["failure"].astype(int))
    table = tests.pivot(index=TEST, columns="version", values="outcome")
    if table.isna().to_numpy().any():
        raise SystemExit(
            f"{Folders(config).root}: expected the same tests of every version, got others; "
            "finish the study with ./run"
        )
    return table.astype(int).reset_index()


def write(outcomes: pd.DataFrame, path: Path) -> None:
    """Write outcomes; the same table gives the same bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    outcomes.to_csv(path, index=False, compression={"method": "gzip", "mtime": 0})


def valid(outcomes: pd.DataFrame) -> pd.DataFrame:
    """Whether each version failed, (tests, versions), of the tests without an error."""
    versions = outcomes.drop(columns=TEST)
    return versions[(versions != ERROR).all(axis=1)] == FAILED


def failures(outcomes: pd.DataFrame) -> dict[str, int]:
    """Failures of each version among the tests without an error."""
    return {str(name): int(count) for name, count in valid(outcomes).sum().items()}


def mean_difference(differences: ArrayLike) -> str:
    """The mean of (n,) differences, one per search, with Student's 95 % interval.

    Such as `-2.0 (-27.4 to +23.4)`; without an interval if all differences are equal.
    """
    values = np.asarray(differences, float)
    mean = f"{values.mean():+.1f}"
    if np.ptp(values) <= TOLERANCE:
        return mean
    low, high = mean_interval(values)
    return f"{mean} ({low:+.1f} to {high:+.1f})"


def student_p(differences: ArrayLike) -> float:
    """The p-value that (n,) differences have mean 0, by Student's t-test; 1 if all are equal."""
    values = np.asarray(differences, float)
    return float(ttest_1samp(values, 0).pvalue) if np.ptp(values) > TOLERANCE else 1.0


def p_text(p_value: float) -> str:
    """A p-value in a table: `0.035`, `< 0.001`."""
    return "< 0.001" if p_value < 0.001 else f"{p_value:.3f}"


def pack(failed: ArrayLike) -> str:
    """The (n,) outcomes of a campaign, true for a failure, as hexadecimal bits."""
    return np.packbits(np.asarray(failed, bool)).tobytes().hex()


def unpack(bits: str, tests: int) -> NDArray[np.bool_]:
    """The (tests,) outcomes of a campaign that `pack` wrote."""
    packed = np.frombuffer(bytes.fromhex(bits), np.uint8)
    return np.unpackbits(packed, count=tests).astype(bool)


def markdown(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table in Markdown. names: the heads of its columns; rows: their cells."""
    lines = [f"| {' | '.join(names)} |", "|---" * len(names) + "|"]
    for row in rows:
        lines.append(f"| {' | '.join(map(str, row))} |")
    return "\n".join(lines)
