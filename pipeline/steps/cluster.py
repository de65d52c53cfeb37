"""Step `cluster`: groups a scenario's failures into regions with readable rules (thesis Def. 4.18, 4.19), confirms and explains them."""

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
    from pipeline.analysis.failure_regions import Found
    from pipeline.core.signals import Signals
    from pipeline.execution.points import Executor
    from pipeline.scenarios.changes import Change


def _executes(config: Config) -> bool:
    return bool(config.regions.confirm or config.regions.explain)


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    files: dict[str, Files] = {
        "space": folders.space(wildcards["scenario"]),
        "tests": folders.search(
            "tests.parquet", wildcards["scenario"], version=wildcards["version"]
        ),
        "signals": folders.search(
            "signals.parquet", wildcards["scenario"], version=wildcards["version"]
        ),
    }
    return (
        files | campaign.detector_files(folders, wildcards["version"])
        if _executes(folders.config)
        else files
    )


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    own = ("regions", "comparison.confidence")
    return (
        (*own, "scenarios.{scenario}", "simulator", *JUDGED, "limits") if _executes(config) else own
    )


STEP = Step(
    "Group the failures of a scenario into regions, confirm their rules, and say why these tests fail.",
    reads=_reads,
    writes=lambda folders: {
        "regions": folders.regions("{version}", "{scenario}"),
        "why": folders.why("{version}", "{scenario}"),
    },
    sections=_sections,
    parallel=True,
)


def run(job: Job) -> None:
    """Find the failure regions of one search scenario over all its campaigns against a version.

    `regions.confirm` fresh tests inside and just outside each rule confirm it. `regions.explain` failures of each region are executed with
    single changes. Errors are left out; a test that two campaigns executed counts once.
    """
    from pipeline.analysis.failure_regions import find_regions, regions_of

    info, logical = read_space(job.input("space"))
    table = read_all_tests(job.inputs("tests"))
    table = table[is_valid(table)].drop_duplicates(list(logical.names), ignore_index=True)
    found = find_regions(info, logical, table, job.config.regions)
    regions = regions_of(info, logical, table, found)
    confirmed = _confirmed(job, logical, found)
    explained, rows = _explained(job, logical, table, found, confirmed)
    write_why(job.output("why"), rows)
    write(job.output("regions"), regions.model_copy(update={"regions": explained}))
    job.progress(
        1,
        1,
        f"{len(regions.regions)} regions of {regions.failures} failures in {regions.tests} tests",
    )


def _confirmed(job: Job, space: Space, found: Sequence[Found]) -> tuple[FailureRegion, ...]:
    """The regions, with the fresh tests that confirm their rules if the study asks for them."""
    from pipeline.execution.confirming import FreshTests

    config = job.config
    if not config.regions.confirm:
        return tuple(one.region for one in found)
    threshold_s, confidence = config.campaign.failure_threshold_s, config.comparison.confidence
    return FreshTests(
        space, _executor(job, "confirm"), threshold_s, config.regions.confirm, confidence
    ).confirm(found)


def _executor(job: Job, journal: str) -> Executor:
    from pipeline.execution.points import Executor

    return Executor(campaign.setup(job), job.scratch / journal, job.threads, job.progress)


def _explained(
    job: Job,
    space: Space,
    tests: pd.DataFrame,
    found: Sequence[Found],
    regions: Sequence[FailureRegion],
) -> tuple[tuple[FailureRegion, ...], pd.DataFrame]:
    """The regions with what the camera saw and what repairs them, and the rows behind both. tests: valid rows."""
    from pipeline.analysis.failure_regions import outcomes_of
    from pipeline.analysis.why import explained, recorded
    from pipeline.execution.explaining import Counterfactuals, table

    config, outcomes, named = (
        job.config,
        outcomes_of(space, tests),
        tests.set_index("test_id", drop=False),
    )
    signals = _signals(job, {test for region in regions for test in region.members})
    rows = [row for region in regions for row in recorded(region, named, signals)]
    changes: list[tuple[Change, ...]] = [() for _ in regions]
    if config.regions.explain and found:
        threshold_s = config.campaign.failure_threshold_s
        executing = Counterfactuals(_executor(job, "explain"), threshold_s, config.regions.explain)
        chosen = [executing.chosen(one, named, outcomes) for one in found]
        changes = [
            executing.planned(one, failures, outcomes, signals)
            for one, failures in zip(found, chosen, strict=True)
        ]
        rows += executing.rows(list(zip(chosen, changes, strict=True)), outcomes)
    made = table(rows)
    confidence = config.comparison.confidence
    return tuple(
        explained(region, made_of, made, confidence)
        for region, made_of in zip(regions, changes, strict=True)
    ), made


def _signals(job: Job, wanted: set[str]) -> Mapping[str, Signals]:
    """The signals of some tests by test_id."""
    found: dict[str, Signals] = {}
    for path in job.inputs("signals"):
        rows = read_signals(path)
        for test, own in rows[rows["test_id"].isin(wanted)].groupby("test_id", sort=False):
            found[str(test)] = {name: own[name].to_numpy() for name in own}
    return found
