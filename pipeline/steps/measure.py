"""Step `measure`: how well each strategy finds failures (thesis sections 4.3 and 6.1), with intervals over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.analysis.measures import (
    PROJECTION_K,
    Key,
    _by_strategy,
    campaign_key,
    measure_campaign,
    summarise,
    theta_table,
)
from pipeline.artefacts.files import write_bytes
from pipeline.artefacts.results import Measures, write
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import read_tests
from pipeline.config.schema import Config
from pipeline.progress import OnProgress


def run(config: Config, *, tests: Sequence[Path], spaces: Sequence[Path], out: Path, theta: Path, progress: OnProgress) -> None:
    """Measure the search campaigns and write measures.json and, for plots, theta.csv.

    tests: tests.parquet of each campaign. spaces: space/<scenario>.json. The first strategy of the config is the baseline of C_n.

    Raises InputError for a campaign without its space or its baseline of the same seed.
    """
    baseline, confidence = config.strategies[0], config.comparison.confidence
    known = {info.name: space for info, space in map(read_space, spaces)}
    tables: dict[Key, pd.DataFrame] = {}
    for path in tests:
        table = read_tests(path).sort_values("index")
        tables[campaign_key(table, path)] = table
    measured = []
    for done, key in enumerate(tables, 1):
        measured.append(measure_campaign(key, tables, known, baseline))
        progress(done, len(tables), "/".join(map(str, key)))
    groups = tuple(summarise(group, confidence) for group in _by_strategy(measured))
    write(out, Measures(confidence=confidence, k=PROJECTION_K, baseline=baseline, campaigns=tuple(measured), strategies=groups))
    write_bytes(theta, theta_table(measured).to_csv(index=False, lineterminator="\n").encode())
