"""Step `campaign`: one strategy tests one model version on one scenario, batch by batch, in closed loop."""

from __future__ import annotations

from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.results import read
from pipeline.artefacts.scenario_space import read_space
from pipeline.config.schema import JUDGED, Config, Target
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.core.identity import CampaignId
from pipeline.errors import InputError

TABLES = ("tests", "signals", "detections", "frames", "timings")
HELD_OUT = "held_out"


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    return {
        "space": folders.space(wildcards["scenario"]),
        **detector_files(folders, wildcards["version"]),
        "earlier": folders.earlier(**wildcards),
    }


def detector_files(folders: Folders, version: str) -> dict[str, Files]:
    """What `detector` reads, and the detector's file."""
    return {"model": folders.detector(version), "calibration": folders.calibrations([version])}


def detector(job: Job) -> Target:
    """The detector's section of the config, calibrated if the study calibrates it."""
    from pipeline.detectors.calibrated import calibrated

    section = job.config.detector
    for path in job.inputs("calibration"):
        section = calibrated(section, read(path, DetectorCalibration).scaling)
    return section


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    """Sections of a comparison's campaign: the size of the search does not matter, but the same threshold judges all tests."""
    held_out = wildcards["kind"] == HELD_OUT
    budget = ("comparison.tests",) if held_out else ("campaign.tests", "campaign.keep_every")
    return ("scenarios.{scenario}", "samplers.{strategy}", "simulator", *JUDGED, *budget)


STEP = Step(
    "Execute a test campaign in closed loop; a killed campaign resumes.",
    reads=_reads,
    writes=lambda folders: {
        name: f"{folders.root}/{{kind}}/{{scenario}}/{{strategy}}/{{version}}/{{seed}}/{name}.parquet" for name in TABLES
    },
    sections=_sections,
    wildcards={"kind": "campaigns|held_out|retrained/campaigns"},
    parallel=True,
)


def run(job: Job) -> None:
    """Execute the campaign and write its tables.

    Except for the timings, the tables depend only on the config, the model and `earlier`, not on the threads or on kills.
    """
    from pipeline.execution.campaign import CampaignPlan, run_campaign, sampler_seed
    from pipeline.execution.workers import Setup

    config, model, wildcards = job.config, job.input("model"), job.wildcards
    campaign = CampaignId(wildcards["scenario"], wildcards["strategy"], wildcards["version"], int(wildcards["seed"]))
    if not model.exists():
        raise InputError(f"{model}: expected the detector of version '{campaign.version}', found none; train it first")
    held_out = wildcards["kind"] == HELD_OUT
    plan = CampaignPlan(
        campaign=campaign,
        space=read_space(job.input("space"))[1],
        tests=config.comparison.tests if held_out else config.campaign.tests,
        failure_threshold_s=config.campaign.failure_threshold_s,
        strategy=config.samplers[campaign.strategy],
        strategy_seed=sampler_seed(campaign, frozen=held_out),
        earlier=job.inputs("earlier"),
        setup=Setup(
            simulator=config.simulator,
            scenario=config.scenarios[campaign.scenario],
            detector=detector(job),
            model=model,
            car=config.car,
            keep_every=0 if held_out else config.campaign.keep_every,
        ),
    )
    run_campaign(plan, job.output("tests"), job.scratch, job.threads, job.progress)
