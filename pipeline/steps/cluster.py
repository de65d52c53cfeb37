"""Step `cluster`: groups a scenario's failures into regions with readable rules.

Regions are those of the thesis, Def. 4.18 and 4.19. Fresh tests confirm and explain them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import pandas as pd

from pipeline.artefacts.folders import Folders
from pipeline.artefacts.region_results import FailureRegion
from pipeline.artefacts.results import write
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import is_valid, read_all_tests, read_signals, write_why
from pipeline.config.schema import JUDGED, Config
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.core.space import Space
from pipeline.steps import campaign

if TYPE_CHECKING:
    from pipeline.analysis.failure_regions import GroupedRegion
    from pipeline.core.signals import Signals
    from pipeline.execution.points import Executor
    from pipeline.scenarios.changes import Change


def _executes(config: Config) -> bool:
    return bool(config.regions.confirm or config.regions.explain)


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    scenario, version = wildcards["scenario"], wildcards["version"]
    files: dict[str, Files] = {
        "space": folders.space(scenario),
        "tests": folders.search("tests.parquet", scenario, version=version),
        "signals": folders.search("signals.parquet", scenario, version=version),
    }
    if _executes(folders.config):
        files |= campaign.detector_files(folders, version)
    return files


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    keys = ("regions", "comparison.confidence")
    if not _executes(config):
        return keys
    return (*keys, "scenarios.{scenario}", "simulator", *JUDGED, "limits")


STEP = Step(
    "Group the failures of a scenario into regions, confirm their rules, explain the failures.",
    reads=_reads,
    writes=lambda folders: {
        "regions": folders.regions("{version}", "{scenario}"),
        "why": folders.why("{version}", "{scenario}"),
    },
    sections=_sections,
    parallel=True,
)


def run(job: Job) -> None:
    """Find the failure regions of a search scenario over all its campaigns against a version.

    `regions.confirm` fresh tests inside and just outside each rule confirm it. `regions.explain`
    failures of each region are executed with single changes. Errors are left out; a test that two
    campaigns executed counts once.
    """
    from pipeline.analysis.failure_regions import find_regions, regions_of
    from pipeline.execution.confirming import FreshTests

    config = job.config
    info, logical = read_space(job.input("space"))
    table = read_all_tests(job.inputs("tests"))
    table = table[is_valid(table)].drop_duplicates(list(logical.names), ignore_index=True)
    groups = find_regions(info, logical, table, config.regions)
    regions = regions_of(info, logical, table, groups)
    confirmed = tuple(group.region for group in groups)
    if config.regions.confirm:
        threshold_s, confidence = config.campaign.failure_threshold_s, config.comparison.confidence
        executor = _executor(job, "confirm")
        fresh = FreshTests(logical, executor, threshold_s, config.regions.confirm, confidence)
        confirmed = fresh.confirm(groups)
    explained, rows = _explained(job, logical, table, groups, confirmed)
    write_why(job.output("why"), rows)
    write(job.output("regions"), regions.model_copy(update={"regions": explained}))
    failures = f"{regions.failures} failures in {regions.tests} tests"
    job.progress(1, 1, f"{len(regions.regions)} regions of {failures}")


def _executor(job: Job, journal: str) -> Executor:
    from pipeline.execution.points import Executor

    return Executor(campaign.setup(job), job.scratch / journal, job.threads, job.progress)


def _explained(
    job: Job,
    space: Space,
    tests: pd.DataFrame,
    groups: Sequence[GroupedRegion],
    regions: Sequence[FailureRegion],
) -> tuple[tuple[FailureRegion, ...], pd.DataFrame]:
    """The regions with what the camera saw and what fixes them, and the rows behind both.

    Args:
        job: the job.
        space: the scenario's space.
        tests: valid rows.
        groups: the failures of each region.
        regions: the confirmed regions, in the order of groups.
    """
    from pipeline.analysis.failure_regions import outcomes_of
    from pipeline.analysis.why import explained, recorded
    from pipeline.execution.explaining import Counterfactuals, table

    config, outcomes = job.config, outcomes_of(space, tests)
    by_id = tests.set_index("test_id", drop=False)
    signals = _signals(job, {test for region in regions for test in region.members})
    rows = [row for region in regions for row in recorded(region, by_id, signals)]
    changes: list[tuple[Change, ...]] = [() for _ in regions]
    if config.regions.explain and groups:
        threshold_s = config.campaign.failure_threshold_s
        executing = Counterfactuals(_executor(job, "explain"), threshold_s, config.regions.explain)
        chosen = [executing.chosen(group, by_id, outcomes) for group in groups]
        changes = [
            executing.planned(group, failures, outcomes, signals)
            for group, failures in zip(groups, chosen, strict=True)
        ]
        rows += executing.rows(list(zip(chosen, changes, strict=True)), outcomes)
    why = table(rows)
    confidence = config.comparison.confidence
    explained_regions = tuple(
        explained(region, tried, why, confidence)
        for region, tried in zip(regions, changes, strict=True)
    )
    return explained_regions, why


def _signals(job: Job, test_ids: set[str]) -> Mapping[str, Signals]:
    """The signals of some tests by test_id."""
    signals: dict[str, Signals] = {}
    for path in job.inputs("signals"):
        rows = read_signals(path)
        for test, steps in rows[rows["test_id"].isin(test_ids)].groupby("test_id", sort=False):
            signals[str(test)] = {name: steps[name].to_numpy() for name in steps}
    return signals
