"""Step `campaign`: one strategy tests one model version on one scenario, batch by batch, in closed loop."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.artefacts.calibration_results import read_calibration
from pipeline.artefacts.folders import AUDITS, SHARDS, Folders
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import TABLES
from pipeline.config.schema import JUDGED, Config
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.core.identity import CampaignId
from pipeline.core.shards import Shard
from pipeline.errors import InputError

if TYPE_CHECKING:
    from pipeline.execution.campaign import CampaignPlan
    from pipeline.execution.workers import Setup

HELD_OUT = "held_out"
KINDS = {"kind": f"campaigns|{AUDITS}|{HELD_OUT}|retrained/campaigns"}
FOLDER = "{kind}/{scenario}/{strategy}/{version}/{seed}"


def reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    """What the tests of a campaign are executed with."""
    return {
        "space": folders.space(wildcards["scenario"]),
        **detector_files(folders, wildcards["version"]),
    }


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    return {
        **reads(folders, wildcards),
        "earlier": folders.earlier(**wildcards),
        **_shards(folders, wildcards),
    }


def _shards(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    """The tables of the jobs that share the campaign, by table; none if one job executes it."""
    config = folders.config
    shards = (
        []
        if config.learns(wildcards["strategy"])
        else Shard.of(_tests(config, wildcards), config.campaign.shards)
    )
    root = f"{folders.root}/{SHARDS}/{FOLDER.format(**wildcards)}"
    return {
        f"shard_{name}": [f"{root}/{shard}/{name}.parquet" for shard in shards] for name in TABLES
    }


def _tests(config: Config, wildcards: Wildcards) -> int:
    if wildcards["kind"] == HELD_OUT:
        return config.comparison.tests
    return config.campaign.audit if wildcards["kind"] == AUDITS else config.campaign.tests


def detector_files(folders: Folders, version: str) -> dict[str, Files]:
    """The files of `setup`: the detector's, and its calibration."""
    return {"model": folders.detector(version), "calibration": folders.calibrations([version])}


def setup(job: Job, keep_every: int = 0) -> Setup:
    """What the tests of a job are executed with: its scenario and its model, calibrated if the study calibrates it."""
    from pipeline.execution.workers import Setup

    calibration = read_calibration(job.inputs("calibration"))
    return Setup.of(
        job.config,
        job.wildcards["scenario"],
        job.input("model"),
        calibration,
        keep_every=keep_every,
    )


def sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    """The size of the search does not matter to the comparison and the audit, but the same threshold judges all tests."""
    budgets = {HELD_OUT: ("comparison.tests",), AUDITS: ("campaign.audit",)}
    budget = budgets.get(wildcards["kind"], ("campaign.tests", "campaign.keep_every"))
    return ("scenarios.{scenario}", "samplers.{strategy}", "simulator", *JUDGED, "limits", *budget)


STEP = Step(
    "Execute a test campaign in closed loop; a killed campaign resumes.",
    reads=_reads,
    writes=lambda folders: {name: f"{folders.root}/{FOLDER}/{name}.parquet" for name in TABLES},
    sections=sections,
    wildcards=KINDS,
    parallel=True,
    parts="shard",
)


def run(job: Job) -> None:
    """Execute the campaign, or join its shards, and write its tables.

    Except for the timings, the tables depend only on the config, the model and `earlier`, not on threads, shards or kills.
    """
    from pipeline.execution.campaign import join, run_campaign

    if shards := job.inputs("shard_tests"):
        join(_named(job.wildcards), shards, read_space(job.input("space"))[1], job.output("tests"))
    else:
        run_campaign(
            planned(job, job.inputs("earlier")),
            job.output("tests"),
            job.scratch,
            job.threads,
            job.progress,
        )


def _named(wildcards: Wildcards) -> CampaignId:
    return CampaignId(
        wildcards["scenario"], wildcards["strategy"], wildcards["version"], int(wildcards["seed"])
    )


def planned(job: Job, earlier: Sequence[Path] = (), shard: Shard | None = None) -> CampaignPlan:
    """The plan of a job's campaign; InputError if its model is missing."""
    from pipeline.execution.campaign import CampaignPlan

    config, model, wildcards = job.config, job.input("model"), job.wildcards
    campaign = _named(wildcards)
    if not model.exists():
        raise InputError(
            f"{model}: expected the detector of version '{campaign.version}', found none; train it first"
        )
    return CampaignPlan(
        campaign=campaign,
        space=read_space(job.input("space"))[1],
        tests=_tests(config, wildcards),
        failure_threshold_s=config.campaign.failure_threshold_s,
        strategy=config.samplers[campaign.strategy],
        earlier=earlier,
        shard=shard,
        frozen=wildcards["kind"] == HELD_OUT,
        setup=setup(
            job, 0 if wildcards["kind"] in (HELD_OUT, AUDITS) else config.campaign.keep_every
        ),
    )
