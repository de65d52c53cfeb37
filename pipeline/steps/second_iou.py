"""Step `second_iou`: the held-out tests of one version and scenario at another IoU, so that no verdict hangs on the first."""

from __future__ import annotations

from dataclasses import replace

from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import write_tests
from pipeline.config.schema import JUDGED
from pipeline.contract import Job, Step
from pipeline.errors import InputError
from pipeline.steps import campaign

FOLDER = campaign.FOLDER.replace("{kind}", campaign.HELD_OUT)

STEP = Step(
    "Judge held-out tests at a second IoU; those in which the car would have braked differently are executed again.",
    reads=lambda folders, wildcards: {
        "space": folders.space(wildcards["scenario"]),
        **campaign.detector_files(folders, wildcards["version"]),
        **{
            name: f"{folders.root}/{FOLDER.format(**wildcards)}/{name}.parquet"
            for name in ("tests", "signals", "detections")
        },
    },
    writes=lambda folders: {"tests": f"{folders.root}/{FOLDER}/second_iou.parquet"},
    sections=("scenarios.{scenario}", "simulator", *JUDGED, "limits", "comparison.second_iou"),
    parallel=True,
)


def run(job: Job) -> None:
    """Write the tests as tests.parquet has them, in its order; InputError if the study asks for no second IoU."""
    from pipeline.analysis.rescoring import with_criterion
    from pipeline.execution.again import driven_again, judged_again
    from pipeline.execution.points import Executor

    config, iou = job.config, job.config.comparison.second_iou
    if iou is None:
        raise InputError("comparison.second_iou: expected an IoU, got null")
    space, threshold_s = read_space(job.input("space"))[1], config.campaign.failure_threshold_s
    car = with_criterion(config.car, iou, config.threshold)
    again = judged_again(job.input("tests").parent, car, threshold_s)
    executor = Executor(
        replace(campaign.setup(job), car=car), job.scratch, job.threads, job.progress
    )
    tests = driven_again(again, space, threshold_s, executor)
    write_tests(job.output("tests"), tests, space)
