"""Step `report`: makes plots, replays and the report page."""

from __future__ import annotations

import pandas as pd

from pipeline.artefacts.files import write_bytes
from pipeline.artefacts.filter_table import read_filter
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.model_card import read_card
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import read
from pipeline.artefacts.scenario_space import read_spaces
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.tables import read_all_tests, read_tests
from pipeline.artefacts.white_box_results import WhiteBoxMeasures
from pipeline.config.schema import JUDGED, Config
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.core.lineage import BASE


def searched(folders: Folders, version: str) -> dict[str, Files]:
    """The files of the search against a version that its report shows."""
    return {
        "measures": f"{folders.root}/measures.json",
        "regions": [folders.regions(version, scenario) for scenario in folders.config.search],
        "tests": folders.search("tests.parquet", version=version),
        "frames": folders.search("frames.parquet", version=version),
        "detections": folders.search("detections.parquet", version=version),
        "spaces": folders.spaces(folders.config.search),
    }


def sections(config: Config) -> tuple[str, ...]:
    """The keys of every report. All scenarios, because any of them may have a replay."""
    scenarios = tuple(f"scenarios.{name}" for name in (*config.search, *config.held_out))
    return ("study", "report", "simulator", "strategies", "held_out", *JUDGED, *scenarios)


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    sources = dict.fromkeys(folders.config.sources.values())
    return {
        **searched(folders, BASE),
        **folders.compared,
        "white_box": f"{folders.root}/white_box.json",
        "later_tests": folders.later_searches,
        "filters": [folders.filter(strategy) for strategy in sources],
        "models": folders.models("model.json"),
        "detectors": folders.models("model.onnx"),
    }


STEP = Step(
    "Write the report, its plots and replays.",
    reads=_reads,
    writes=lambda folders: {"page": f"{folders.root}/report.html", "plots": folders.plots},
    sections=lambda config, wildcards: (*sections(config), "filter", "arms"),
)


def run(job: Job) -> None:
    """Write report.html and its plots."""
    from pipeline.report.contents import border_cases, draw_figures, make_page
    from pipeline.report.data import ComparedVersions, ReportData
    from pipeline.report.page import render
    from pipeline.report.style import save_png

    config = job.config
    rows = read_all_tests(job.inputs("tests"))
    cards = tuple(read_card(path) for path in job.inputs("models"))
    sources = list(dict.fromkeys(config.sources.values()))
    filters = dict(zip(sources, map(read_filter, job.inputs("filters")), strict=True))
    learnt = [rows[rows["strategy"].isin(sources)], *map(read_tests, job.inputs("later_tests"))]
    data = ReportData(
        version=BASE,
        measures=read(job.input("measures"), Measures),
        regions=tuple(read(path, FailureRegions) for path in job.inputs("regions")),
        scenarios=read_spaces(job.inputs("spaces")),
        rows=rows,
        learnt=pd.concat(learnt, ignore_index=True),
        detectors=dict(zip((card.version for card in cards), job.inputs("detectors"), strict=True)),
        frames=job.inputs("frames"),
        files=job.digests(),
        white_box=read(job.input("white_box"), WhiteBoxMeasures),
        compared=ComparedVersions.read(
            job.input("comparison"), job.input("table"), job.input("changes")
        ),
        filters=filters,
        cards=cards,
        border=border_cases(config, filters, job.inputs("frames")),
    )
    figures = draw_figures(data, list(config.strategies), config.campaign.failure_threshold_s)
    for path in job.outputs("plots"):
        save_png(figures[path.stem], path)
    write_bytes(job.output("page"), render(make_page(config, data, figures, job.progress)).encode())
