"""The executed tests of a study, by name, and those below any folders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import pandas as pd

from pipeline.artefacts.folders import SHARDS, Folders
from pipeline.artefacts.tables import read_tests
from pipeline.config.composing import load
from pipeline.core.names import nearest
from pipeline.errors import InputError

DATA = Path("data")


def recorded(folders: Folders, test: str) -> pd.Series:
    """The row of a test; InputError if the study has no such test, or if it ended in an error."""
    tables = campaigns(folders)
    campaign = test.rpartition("-")[0]
    if not campaign:
        raise InputError(f"expected a test such as F1-forest-base-0-00012, got '{test}'")
    if campaign not in tables:
        params = _own_params(campaign)
        hint = f"; choose its study: --params {' or '.join(map(str, params))}" if params else ""
        if not tables and not hint:
            raise InputError(
                f"study {folders.config.study} has no executed campaign here; make it with ./run"
            )
        raise InputError(
            f"study {folders.config.study} has no campaign "
            f"'{campaign}'{hint or nearest(campaign, list(tables))}"
        )
    table = read_tests(tables[campaign]).set_index("test_id", drop=False)
    if test not in table.index:
        raise InputError(
            f"{tables[campaign]} has the tests {table.index[0]} to {table.index[-1]}, got {test}"
        )
    row = table.loc[test]
    if row["status"] == "error":
        raise InputError(
            f"{test} ended in an error, so there is nothing to replay: {row['reason']}"
        )
    return row


def params_of(test: str, params: Path) -> Path:
    """The configuration of the study that has executed a test.

    It is `params`, unless exactly one study with its own params.yaml, as `test-detector` makes
    them, has executed it.
    """
    campaign = test.rpartition("-")[0]
    if params.is_file() and campaign in campaigns(Folders(load(params))):
        return params
    candidates = _own_params(campaign)
    return candidates[0] if len(candidates) == 1 else params


def _own_params(campaign: str) -> list[Path]:
    """The params.yaml of every study with one of its own that has executed a campaign."""

    matching = []
    for path in sorted(DATA.glob("*/params.yaml")):
        with suppress(InputError):  # Another study's damage does not matter here.
            if campaign in campaigns(Folders(load(path))):
                matching.append(path)
    return matching


def campaigns(folders: Folders) -> Mapping[str, Path]:
    """The table of each executed campaign of a study, by the beginning of its tests' names."""
    tables = [
        *folders.searches,
        *folders.audits,
        *folders.later_searches,
        *folders.held_out("tests.parquet"),
    ]
    paths = map(Path, tables)
    return {"-".join(path.parts[-5:-1]): path for path in paths if path.is_file()}


def tables_below(folders: Sequence[Path]) -> list[Path]:
    """Every tests.parquet below some folders, sorted; InputError for a folder without one.

    The shards of a campaign are left out: the campaign has their tests.
    """
    tables: set[Path] = set()
    empty = []
    for folder in folders:
        below = folder.rglob("tests.parquet")
        whole = [path for path in below if SHARDS not in path.relative_to(folder).parts]
        tables.update(whole)
        if not whole:
            empty.append(str(folder))
    if empty:
        raise InputError(f"{', '.join(empty)}: expected campaigns, found no tests.parquet")
    return sorted(tables)
