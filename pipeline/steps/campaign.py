"""Step `campaign`: a strategy tests a model version on a scenario in closed loop, in batches."""

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


def detector_files(folders: Folders, version: str) -> dict[str, Files]:
    """The files of `setup`: the detector's, and its calibration."""
    return {"model": folders.detector(version), "calibration": folders.calibrations([version])}


def reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    """The files that executing the tests of a campaign needs."""
    return {
        "space": folders.space(wildcards["scenario"]),
        **detector_files(folders, wildcards["version"]),
    }


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    """Also the earlier campaigns, and the tables of the jobs that share the campaign, if any."""
    config = folders.config
    shards: list[Shard] = []
    if not config.learns(wildcards["strategy"]):
        shards = Shard.of(_tests(config, wildcards), config.campaign.shards)
    files = {**reads(folders, wildcards), "earlier": folders.earlier(**wildcards)}
    root = f"{folders.root}/{SHARDS}/{FOLDER.format(**wildcards)}"
    for name in TABLES:
        files[f"shard_{name}"] = [f"{root}/{shard}/{name}.parquet" for shard in shards]
    return files


def _tests(config: Config, wildcards: Wildcards) -> int:
    if wildcards["kind"] == HELD_OUT:
        return config.comparison.tests
    return config.campaign.audit if wildcards["kind"] == AUDITS else config.campaign.tests


def setup(job: Job, keep_every: int = 0) -> Setup:
    """The setup of the tests of a job: its scenario and its model, calibrated if the study asks.

    Args:
        job: of any step that declares `detector_files`.
        keep_every: number of frames of which the first is kept; 0 for none.
    """
    from pipeline.execution.workers import Setup

    scenario, model = job.wildcards["scenario"], job.input("model")
    calibration = read_calibration(job.inputs("calibration"))
    return Setup.of(job.config, scenario, model, calibration, keep_every=keep_every)


def sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    """The keys that a campaign depends on.

    The size of the search does not matter to the comparison and the audit, but the same threshold
    judges all tests.
    """
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

    Except for the timings, the tables depend only on the config, the model and `earlier`, not on
    threads, shards or kills.
    """
    from pipeline.execution.campaign import join, run_campaign

    tests = job.output("tests")
    if shards := job.inputs("shard_tests"):
        join(_identity(job.wildcards), shards, read_space(job.input("space"))[1], tests)
    else:
        plan = planned(job, job.inputs("earlier"))
        run_campaign(plan, tests, job.scratch, job.threads, job.progress)


def _identity(wildcards: Wildcards) -> CampaignId:
    return CampaignId(
        wildcards["scenario"], wildcards["strategy"], wildcards["version"], int(wildcards["seed"])
    )


def planned(job: Job, earlier: Sequence[Path] = (), shard: Shard | None = None) -> CampaignPlan:
    """The plan of a job's campaign.

    Args:
        job: of this step or of step `shard`.
        earlier: tables of tests from which the strategy learns.
        shard: the part of the campaign to execute; None for all of it.

    Raises:
        InputError: the model is missing.
    """
    from pipeline.execution.campaign import CampaignPlan

    config, model, wildcards = job.config, job.input("model"), job.wildcards
    campaign = _identity(wildcards)
    if not model.exists():
        raise InputError(
            f"{model}: expected the detector of version '{campaign.version}', found none; "
            "train it first"
        )
    frozen = wildcards["kind"] == HELD_OUT
    keeps_no_frames = frozen or wildcards["kind"] == AUDITS
    return CampaignPlan(
        campaign=campaign,
        space=read_space(job.input("space"))[1],
        tests=_tests(config, wildcards),
        failure_threshold_s=config.campaign.failure_threshold_s,
        strategy=config.samplers[campaign.strategy],
        earlier=earlier,
        shard=shard,
        frozen=frozen,
        setup=setup(job, 0 if keeps_no_frames else config.campaign.keep_every),
    )
