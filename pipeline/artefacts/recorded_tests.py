"""The executed tests of a study, by name, and those below any folders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from pipeline.artefacts.folders import Folders
from pipeline.artefacts.tables import read_tests
from pipeline.core.names import nearest
from pipeline.errors import InputError


def recorded(folders: Folders, test: str) -> pd.Series:
    """The row of a test; InputError if the study has no such test, or if it ended in an error."""
    tables = campaigns(folders)
    campaign = test.rpartition("-")[0]
    if campaign not in tables:
        hint = _elsewhere(campaign, Path(folders.root).parent)
        if not tables and not hint:
            raise InputError(f"study {folders.config.study} has no executed campaign here; make it with ./run")
        raise InputError(f"study {folders.config.study} has no campaign '{campaign}'{hint or nearest(campaign, list(tables))}")
    table = read_tests(tables[campaign]).set_index("test_id", drop=False)
    if test not in table.index:
        raise InputError(f"{tables[campaign]} has the tests {table.index[0]} to {table.index[-1]}, got {test}")
    row = table.loc[test]
    if row["status"] == "error":
        raise InputError(f"{test} ended in an error, so there is nothing to replay: {row['reason']}")
    return row


def _elsewhere(campaign: str, data: Path) -> str:
    """Which study with a params.yaml of its own, as `test-detector` makes them, has executed a campaign; empty if none."""
    for params in sorted(data.glob("*/params.yaml")):
        if any("-".join(path.parts[-5:-1]) == campaign for path in params.parent.glob("*/*/*/*/*/tests.parquet")):
            return f"; study {params.parent.name} has: add --params {params}"
    return ""


def campaigns(folders: Folders) -> Mapping[str, Path]:
    """The table of each executed campaign of a study, by the beginning of its tests' names."""
    tables = [*folders.searches, *folders.audits, *folders.later_searches, *folders.held_out("tests.parquet")]
    paths = map(Path, tables)
    return {"-".join(path.parts[-5:-1]): path for path in paths if path.is_file()}


def tables_below(folders: Sequence[Path]) -> list[Path]:
    """Every tests.parquet below some folders, sorted; InputError if there is none."""
    paths = sorted({path for folder in folders for path in folder.rglob("tests.parquet")})
    if not paths:
        raise InputError(f"{', '.join(map(str, folders))}: expected campaigns, found no tests.parquet")
    return paths
