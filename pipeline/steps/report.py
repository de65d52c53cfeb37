"""Step `report`: makes plots, replays and the report page."""

from __future__ import annotations

import pandas as pd

from pipeline.artefacts.comparison_results import Comparison, read_changes
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


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    config, root = folders.config, folders.root
    return {
        "measures": f"{root}/measures.json",
        "white_box": f"{root}/white_box.json",
        "comparison": f"{root}/comparison.json",
        "table": f"{root}/comparison.parquet",
        "changes": f"{root}/changes.csv",
        "regions": [folders.regions(BASE, scenario) for scenario in config.search],
        "tests": folders.search("tests.parquet"),
        "frames": folders.search("frames.parquet"),
        "detections": folders.search("detections.parquet"),
        "later_tests": folders.later_searches,
        "spaces": folders.spaces(config.search),
        "filters": [folders.filter(strategy) for strategy in dict.fromkeys(config.sources.values())],
        "models": folders.models("model.json"),
        "detectors": folders.models("model.onnx"),
    }


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    """All scenarios, because any of them may have a replay."""
    scenarios = tuple(f"scenarios.{name}" for name in (*config.search, *config.held_out))
    own = ("study", "report", "filter", "simulator", "strategies", "arms", "held_out", *JUDGED)
    return (*own, *scenarios)


STEP = Step(
    "Write the report, its plots and replays.",
    reads=_reads,
    writes=lambda folders: {"page": f"{folders.root}/report.html", "plots": folders.plots},
    sections=_sections,
)


def run(job: Job) -> None:
    """Write report.html and its plots."""
    from pipeline.report.contents import border_cases, draw_figures, make_page
    from pipeline.report.data import ComparedVersions, ReportData
    from pipeline.report.page import render
    from pipeline.report.style import save_png

    config = job.config
    known = read_spaces(job.inputs("spaces"))
    rows = read_all_tests(job.inputs("tests"))
    cards = tuple(read_card(path) for path in job.inputs("models"))
    sources = list(dict.fromkeys(config.sources.values()))
    learnt = rows[rows["strategy"].isin(sources)]
    filters = dict(zip(sources, map(read_filter, job.inputs("filters")), strict=True))
    data = ReportData(
        version=BASE,
        measures=read(job.input("measures"), Measures),
        white_box=read(job.input("white_box"), WhiteBoxMeasures),
        compared=ComparedVersions(
            comparison=read(job.input("comparison"), Comparison),
            tests=read_tests(job.input("table")),
            changes=read_changes(job.input("changes")),
        ),
        regions=tuple(read(path, FailureRegions) for path in job.inputs("regions")),
        tests={name: rows[rows["scenario"] == name] for name in known},
        searched=pd.concat([learnt, *map(read_tests, job.inputs("later_tests"))], ignore_index=True),
        spaces={name: space for name, (_, space) in known.items()},
        labels={name: info.label for name, (info, _) in known.items()},
        filters=filters,
        cards=cards,
        detectors=dict(zip((card.version for card in cards), job.inputs("detectors"), strict=True)),
        frames=job.inputs("frames"),
        files=job.digests(),
        border=border_cases(config, filters, job.inputs("frames")),
    )
    figures = draw_figures(data, list(config.strategies), config.campaign.failure_threshold_s)
    for path in job.outputs("plots"):
        save_png(figures[path.stem], path)
    write_bytes(job.output("page"), render(make_page(config, data, figures, job.progress)).encode())
