"""Step `detector_report`: the page of a detector that a study only tests.

It shows failures, regions, replays and, with several detectors, the comparison.
"""

from __future__ import annotations

from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.artefacts.files import write_bytes
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import read
from pipeline.artefacts.scenario_space import read_spaces
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.tables import read_all_tests
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.steps import report


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    tested = folders.config.tested
    return {
        **report.searched(folders, wildcards["version"]),
        **(folders.compared if len(tested) > 1 else {}),
        "detectors": [folders.detector(name) for name in tested],
        "calibrations": folders.calibrations(tested),
    }


STEP = Step(
    "Write the page of a detector under test.",
    reads=_reads,
    writes=lambda folders: {"page": f"{folders.root}/reports/{{version}}.html"},
    sections=lambda config, wildcards: (*report.sections(config), "tested"),
)


def run(job: Job) -> None:
    """Write the page; every detector's page contains the comparison."""
    from pipeline.report.contents import draw_figures, make_page
    from pipeline.report.data import ComparedVersions, ReportData
    from pipeline.report.page import render

    config, version = job.config, job.wildcards["version"]
    compared = None
    if "comparison" in job.reads:
        compared = ComparedVersions.read(
            job.input("comparison"), job.input("table"), job.input("changes")
        )
    rows = read_all_tests(job.inputs("tests"))
    calibrations = [read(path, DetectorCalibration) for path in job.inputs("calibrations")]
    # The page's own detector comes first.
    calibrations.sort(key=lambda calibration: calibration.version != version)
    data = ReportData(
        version=version,
        measures=read(job.input("measures"), Measures).of(version),
        regions=tuple(read(path, FailureRegions) for path in job.inputs("regions")),
        scenarios=read_spaces(job.inputs("spaces")),
        rows=rows,
        learnt=rows,
        detectors=dict(zip(config.tested, job.inputs("detectors"), strict=True)),
        frames=job.inputs("frames"),
        files=job.digests(),
        compared=compared,
        calibrations={calibration.version: calibration for calibration in calibrations},
    )
    figures = draw_figures(data, list(config.strategies), config.campaign.failure_threshold_s)
    write_bytes(job.output("page"), render(make_page(config, data, figures, job.progress)).encode())
