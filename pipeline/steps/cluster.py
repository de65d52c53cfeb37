"""Step `cluster`: groups a scenario's failures into regions with readable rules (thesis Def. 4.18, 4.19)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from pipeline.artefacts.folders import Folders
from pipeline.artefacts.results import write
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import read_tests
from pipeline.config.schema import JUDGED, Config
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.core.space import Space
from pipeline.steps import campaign

if TYPE_CHECKING:
    from pipeline.execution.confirming import FreshTests


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    files: dict[str, Files] = {
        "space": folders.space(wildcards["scenario"]),
        "tests": folders.search("tests.parquet", wildcards["scenario"], version=wildcards["version"]),
    }
    return files | campaign.detector_files(folders, wildcards["version"]) if folders.config.regions.confirm else files


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    executes = ("scenarios.{scenario}", "simulator", *JUDGED, "limits", "comparison.confidence")
    return ("regions", *executes) if config.regions.confirm else ("regions",)


STEP = Step(
    "Group the failures of a scenario into regions, and confirm their rules.",
    reads=_reads,
    writes=lambda folders: {"regions": folders.regions("{version}", "{scenario}")},
    sections=_sections,
    parallel=True,
)


def run(job: Job) -> None:
    """Find the failure regions of one search scenario over all its campaigns against a version; `regions.confirm` fresh tests inside and
    just outside each rule confirm it.

    Errors are left out; a test that two campaigns executed counts once.
    """
    from pipeline.analysis.failure_regions import find_regions, regions_of

    info, logical = read_space(job.input("space"))
    table = pd.concat([read_tests(path) for path in job.inputs("tests")], ignore_index=True)
    table = table[table["status"] == "ok"].drop_duplicates(list(logical.names), ignore_index=True)
    found = find_regions(info, logical, table, job.config.regions)
    regions = regions_of(info, logical, table, found)
    if job.config.regions.confirm:
        regions = regions.model_copy(update={"regions": fresh_tests(job, logical).confirm(found, job.threads, job.progress)})
    write(job.output("regions"), regions)
    job.progress(1, 1, f"{len(regions.regions)} regions of {regions.failures} failures in {regions.tests} tests")


def fresh_tests(job: Job, space: Space) -> FreshTests:
    """What confirms the rules of a job."""
    from pipeline.execution.confirming import FreshTests
    from pipeline.execution.workers import Setup

    config, scenario = job.config, job.config.scenarios[job.wildcards["scenario"]]
    return FreshTests(
        space=space,
        setup=Setup(config.simulator, scenario, campaign.detector(job), job.input("model"), config.car, config.limits),
        failure_threshold_s=config.campaign.failure_threshold_s,
        tests=config.regions.confirm,
        confidence=config.comparison.confidence,
        journal=job.scratch,
    )
