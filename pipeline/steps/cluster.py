"""Step `cluster`: groups a scenario's failures into regions that a person can read (thesis Def. 4.18, 4.19)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.analysis.failure_regions import (
    cluster,
    not_solvable,
)
from pipeline.artefacts.results import write
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import read_tests
from pipeline.config.schema import Config
from pipeline.progress import OnProgress


def run(config: Config, *, tests: Sequence[Path], space: Path, out: Path, progress: OnProgress) -> None:
    """Find the failure regions of one search scenario over all its campaigns.

    tests: tests.parquet of each campaign of the scenario, signals.parquet beside it. Tests whose simulation broke are left out; what two
    campaigns executed, as strategies that begin with the same random batch, counts once.
    """
    info, logical = read_space(space)
    table = pd.concat([read_tests(path) for path in tests], ignore_index=True)
    table = table[table["status"] == "ok"].drop_duplicates(list(logical.names), ignore_index=True)
    regions = cluster(info, logical, table, config.regions.chance_neighbours, config.regions.min_failures, config.comparison.confidence)
    regions = regions.model_copy(update={"not_solvable": not_solvable(table, tests)})
    write(out, regions)
    progress(1, 1, f"{len(regions.regions)} regions of {regions.failures} failures in {regions.tests} tests")
