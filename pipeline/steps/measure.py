"""Step `measure`: measures each search campaign (thesis section 4.3).

It counts failures and computes the F-, F_n- and C_n-measures and the coverage.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.artefacts.files import write_bytes
from pipeline.artefacts.results import write
from pipeline.artefacts.scenario_space import read_spaces
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.tables import campaign_of, read_tests
from pipeline.contract import Job, Step
from pipeline.core.identity import CampaignId

STEP = Step(
    "Measure the search campaigns.",
    reads=lambda folders, wildcards: {
        "spaces": folders.spaces(folders.config.search),
        "tests": folders.searches,
        "audit": folders.audits,
    },
    writes=lambda folders: {
        "measures": f"{folders.root}/measures.json",
        "theta": f"{folders.root}/theta.csv",
    },
    sections=lambda config, wildcards: (
        "strategies",
        "comparison.confidence",
        *(f"samplers.{name}" for name in config.strategies),
    ),
)


def run(job: Job) -> None:
    """Measure the campaigns and write measures.json and, for plots, theta.csv.

    The first strategy of the config is the baseline of C_n.

    Raises:
        InputError: a campaign has no space, or no baseline of the same seed.
    """
    from pipeline.analysis.measures import (
        audited,
        by_strategy,
        measure_campaign,
        summarise,
        theta_table,
    )

    baseline, confidence = job.config.strategies[0], job.config.comparison.confidence
    described = read_spaces(job.inputs("spaces"))
    spaces = {name: space for name, (_, space) in described.items()}
    tables, audit = _tables(job.inputs("tests")), _tables(job.inputs("audit"))
    measured = []
    for done, campaign in enumerate(tables, 1):
        measured.append(measure_campaign(campaign, tables, spaces, baseline))
        job.progress(done, len(tables), str(campaign))
    independent = set(filter(job.config.independent, job.config.strategies))
    for campaign, table in tables.items():
        if campaign.strategy in independent:
            audit[campaign] = table
    groups = [
        summarise(group, confidence, baseline, independent) for group in by_strategy(measured)
    ]
    no_braking = [name for name, (info, _) in described.items() if not info.asks_to_brake]
    measures = Measures(
        confidence=confidence,
        baseline=baseline,
        campaigns=tuple(measured),
        strategies=tuple(groups),
        audit=audited(audit, confidence),
        no_braking=tuple(no_braking),
    )
    write(job.output("measures"), measures)
    theta = theta_table(measured).to_csv(index=False, lineterminator="\n")
    write_bytes(job.output("theta"), theta.encode())


def _tables(paths: Sequence[Path]) -> dict[CampaignId, pd.DataFrame]:
    """The tests of campaigns, in the order executed."""
    tables = {}
    for path in paths:
        table = read_tests(path).sort_values("index")
        tables[campaign_of(table, path)] = table
    return tables
