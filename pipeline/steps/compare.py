"""Step `compare`: every model version on the same frozen held-out sequence (thesis section 7.3), paired test by test."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.analysis.comparison import (
    _check_threshold,
    changed_tests,
    check_sequences,
    compare,
    flat_metrics,
    held_out_regions,
)
from pipeline.analysis.measures import campaign_key
from pipeline.artefacts.files import write_bytes, write_json
from pipeline.artefacts.model_card import read_card
from pipeline.artefacts.results import (
    Measures,
    read,
    write,
)
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import read_tests, write_tests
from pipeline.config.schema import Config
from pipeline.progress import OnProgress


def run(
    config: Config,
    *,
    tests: Sequence[Path],
    spaces: Sequence[Path],
    models: Sequence[Path],
    measures: Path,
    out: Path,
    table: Path,
    changes: Path,
    metrics: Path,
    progress: OnProgress,
) -> None:
    """Compare the versions and write comparison.json, all their tests as comparison.parquet, those that changed as changes.csv, and
    metrics.json.

    tests: tests.parquet of each held-out scenario and version. spaces: of the held-out scenarios. models: model.json of each
    version; their order is the order of the versions. measures: measures.json of the search.

    Raises InputError if the versions were not executed on the same points in the same order, or one has no campaign, or was judged at
    another threshold than the config's.
    """
    infos = {info.name: (info, space) for info, space in map(read_space, spaces)}
    cards = [read_card(path) for path in models]
    tables = {}
    for done, path in enumerate(tests, 1):
        rows = read_tests(path).sort_values("index", ignore_index=True)
        scenario, _, version, _ = campaign_key(rows, path)
        _check_threshold(rows, config.campaign.failure_threshold_s, path)
        tables[scenario, version] = rows
        progress(done, len(tests), f"{scenario}/{version}")
    versions = [card.version for card in cards]
    digest = check_sequences(tables, {name: space.names for name, (_, space) in infos.items()}, versions)
    joined = pd.concat([tables[name, version] for name in infos for version in versions], ignore_index=True)
    labels = {name: info.label for name, (info, _) in infos.items()}
    regions = [
        region
        for name, (info, space) in infos.items()
        for region in held_out_regions(info, space, {version: tables[name, version] for version in versions}, config)
    ]
    settings = config.comparison
    result = compare(joined, labels, versions, digest, regions, alpha=settings.alpha, confidence=settings.confidence)
    write(out, result)
    write_tests(table, joined, next(space for _, space in infos.values()))
    variables = list(next(space for _, space in infos.values()).names)
    write_bytes(changes, changed_tests(result, joined, variables).to_csv(index=False, lineterminator="\n", float_format="%.6g").encode())
    write_json(metrics, flat_metrics(result, read(measures, Measures), {card.version: card.metrics for card in cards}))
