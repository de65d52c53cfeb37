"""Step `compare`: every model version on the same frozen held-out sequence (thesis section 7.3), paired test by test."""

from __future__ import annotations

import pandas as pd

from pipeline.artefacts.files import write_bytes, write_json
from pipeline.artefacts.model_card import read_card
from pipeline.artefacts.results import Measures, read, write
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import campaign_of, read_tests, write_tests
from pipeline.contract import Job, Step

STEP = Step(
    "Compare all model versions on the held-out sequence.",
    reads=lambda folders, wildcards: {
        "spaces": folders.spaces(folders.config.held_out),
        "tests": folders.held_out("tests.parquet"),
        "models": folders.models("model.json"),
        "measures": f"{folders.root}/measures.json",
    },
    writes=lambda folders: {
        "comparison": f"{folders.root}/comparison.json",
        "table": f"{folders.root}/comparison.parquet",
        "changes": f"{folders.root}/changes.csv",
        "metrics": f"{folders.root}/metrics.json",
    },
    sections=("comparison.alpha", "comparison.confidence", "regions", "campaign.failure_threshold_s"),
)


def run(job: Job) -> None:
    """Compare the versions and write the comparison, all their tests, those that changed, and the metrics that DVC shows.

    The order of the models is the order of the versions.

    Raises InputError if the versions were not executed on the same points in the same order, if one has no campaign, was judged at
    another threshold than the config's, or has learnt a held-out town.
    """
    from pipeline.analysis.comparison import _check_threshold, changed_tests, check_sequences, compare, flat_metrics, held_out_regions
    from pipeline.learning.leakage import refuse_learnt

    config = job.config
    infos = {info.name: (info, space) for info, space in map(read_space, job.inputs("spaces"))}
    cards = [read_card(path) for path in job.inputs("models")]
    refuse_learnt(cards, [info for info, _ in infos.values()])
    tables = {}
    for done, path in enumerate(job.inputs("tests"), 1):
        rows = read_tests(path).sort_values("index", ignore_index=True)
        campaign = campaign_of(rows, path)
        _check_threshold(rows, config.campaign.failure_threshold_s, path)
        tables[campaign.scenario, campaign.version] = rows
        job.progress(done, len(job.inputs("tests")), f"{campaign.scenario}/{campaign.version}")
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
    write(job.output("comparison"), result)
    first = next(space for _, space in infos.values())
    write_tests(job.output("table"), joined, first)
    changes = changed_tests(result, joined, first.names)
    write_bytes(job.output("changes"), changes.to_csv(index=False, lineterminator="\n", float_format="%.6g").encode())
    detection = {card.version: card.metrics for card in cards}
    write_json(job.output("metrics"), flat_metrics(result, read(job.input("measures"), Measures), detection))
