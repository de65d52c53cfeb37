"""Step `detector_report`: the page of a detector that a study only tests: failures, regions, replays and, with several detectors, the
comparison."""

from __future__ import annotations

from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.artefacts.comparison_results import Comparison, read_changes
from pipeline.artefacts.files import write_bytes
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import read
from pipeline.artefacts.scenario_space import read_spaces
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.tables import read_all_tests, read_tests
from pipeline.config.schema import JUDGED, Config
from pipeline.contract import Files, Job, Step, Wildcards


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    config, version = folders.config, wildcards["version"]
    files: dict[str, Files] = {
        "measures": f"{folders.root}/measures.json",
        "regions": [folders.regions(version, scenario) for scenario in config.search],
        "tests": folders.search("tests.parquet", version=version),
        "frames": folders.search("frames.parquet", version=version),
        "detections": folders.search("detections.parquet", version=version),
        "spaces": folders.spaces(config.search),
        "detectors": [folders.detector(name) for name in config.tested],
        "calibrations": folders.calibrations(config.tested),
    }
    if len(config.tested) > 1:
        files |= {name: f"{folders.root}/{file}" for name, file in COMPARISON.items()}
    return files


COMPARISON = {"comparison": "comparison.json", "table": "comparison.parquet", "changes": "changes.csv"}


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    """All scenarios, because any of them may have a replay."""
    scenarios = tuple(f"scenarios.{name}" for name in (*config.search, *config.held_out))
    own = ("study", "tested", "report", "simulator", "strategies", "held_out", *JUDGED)
    return (*own, *scenarios)


STEP = Step(
    "Write the page of a detector under test.",
    reads=_reads,
    writes=lambda folders: {"page": f"{folders.root}/reports/{{version}}.html"},
    sections=_sections,
)


def run(job: Job) -> None:
    """Write the page; every detector's page contains the comparison."""
    from pipeline.report.contents import draw_figures, make_page
    from pipeline.report.data import ComparedVersions, ReportData
    from pipeline.report.page import render

    config, version = job.config, job.wildcards["version"]
    known = read_spaces(job.inputs("spaces"))
    rows = read_all_tests(job.inputs("tests"))
    calibrations = [read(path, DetectorCalibration) for path in job.inputs("calibrations")]
    calibrations.sort(key=lambda found: found.version != version)  # The page's own detector comes first.
    compared = None
    if "comparison" in job.reads:
        comparison = read(job.input("comparison"), Comparison)
        compared = ComparedVersions(comparison, tests=read_tests(job.input("table")), changes=read_changes(job.input("changes")))
    data = ReportData(
        version=version,
        measures=read(job.input("measures"), Measures).of(version),
        white_box=None,
        compared=compared,
        regions=tuple(read(path, FailureRegions) for path in job.inputs("regions")),
        tests={name: rows[rows["scenario"] == name] for name in known},
        searched=rows,
        spaces={name: space for name, (_, space) in known.items()},
        labels={name: info.label for name, (info, _) in known.items()},
        calibrations={found.version: found for found in calibrations},
        filters={},
        cards=(),
        detectors=dict(zip(config.tested, job.inputs("detectors"), strict=True)),
        frames=job.inputs("frames"),
        files=job.digests(),
        border=(),
    )
    figures = draw_figures(data, list(config.strategies), config.campaign.failure_threshold_s)
    write_bytes(job.output("page"), render(make_page(config, data, figures, job.progress)).encode())
