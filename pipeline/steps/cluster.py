"""Step `cluster`: groups a scenario's failures into regions with readable rules (thesis Def. 4.18, 4.19)."""

from __future__ import annotations

import pandas as pd

from pipeline.artefacts.results import write
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import read_tests
from pipeline.contract import Job, Step

STEP = Step(
    "Group the failures of a scenario into regions.",
    reads=lambda folders, wildcards: {
        "space": folders.space(wildcards["scenario"]),
        "tests": folders.search("tests.parquet", wildcards["scenario"], version=wildcards["version"]),
    },
    writes=lambda folders: {"regions": folders.regions("{version}", "{scenario}")},
    sections=("regions",),
)


def run(job: Job) -> None:
    """Find the failure regions of one search scenario over all its campaigns against a version.

    Errors are left out; a test that two campaigns executed counts once.
    """
    from pipeline.analysis.failure_regions import cluster

    info, logical = read_space(job.input("space"))
    table = pd.concat([read_tests(path) for path in job.inputs("tests")], ignore_index=True)
    table = table[table["status"] == "ok"].drop_duplicates(list(logical.names), ignore_index=True)
    regions = cluster(info, logical, table, job.config.regions)
    write(job.output("regions"), regions)
    job.progress(1, 1, f"{len(regions.regions)} regions of {regions.failures} failures in {regions.tests} tests")
