"""Step `second_iou`: the held-out tests of a version and scenario at another IoU.

It shows whether the verdict depends on the first IoU.
"""

from __future__ import annotations

from dataclasses import replace

from pipeline.artefacts.folders import Folders
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import write_tests
from pipeline.config.schema import JUDGED
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.errors import InputError
from pipeline.steps import campaign

FOLDER = campaign.FOLDER.replace("{kind}", campaign.HELD_OUT)


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    files = campaign.reads(folders, wildcards)
    for name in ("tests", "signals", "detections"):
        files[name] = f"{folders.root}/{FOLDER.format(**wildcards)}/{name}.parquet"
    return files


STEP = Step(
    "Judge held-out tests at a second IoU; execute those again in which the car brakes otherwise.",
    reads=_reads,
    writes=lambda folders: {"tests": f"{folders.root}/{FOLDER}/second_iou.parquet"},
    sections=("scenarios.{scenario}", "simulator", *JUDGED, "limits", "comparison.second_iou"),
    parallel=True,
)


def run(job: Job) -> None:
    """Write the tests as tests.parquet has them, in its order.

    Raises:
        InputError: the study asks for no second IoU.
    """
    from pipeline.analysis.rescoring import with_criterion
    from pipeline.execution.again import driven_again, judged_again
    from pipeline.execution.points import Executor

    config, iou = job.config, job.config.comparison.second_iou
    if iou is None:
        raise InputError("comparison.second_iou: expected an IoU, got null")
    space, threshold_s = read_space(job.input("space"))[1], config.campaign.failure_threshold_s
    car = with_criterion(config.car, iou, config.threshold)
    again = judged_again(job.input("tests").parent, car, threshold_s)
    setup = replace(campaign.setup(job), car=car)
    executor = Executor(setup, job.scratch, job.threads, job.progress)
    tests = driven_again(again, space, threshold_s, executor)
    write_tests(job.output("tests"), tests, space)
