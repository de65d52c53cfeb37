"""What the report is made of."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import pandas as pd
from hydra.utils import instantiate
from matplotlib.figure import Figure

from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.model_card import ModelCard
from pipeline.artefacts.results import FailureRegions, Measures, WhiteBoxMeasures
from pipeline.config.schema import Config
from pipeline.core.space import Space
from pipeline.progress import OnProgress
from pipeline.protocols import Detector, Simulator
from pipeline.report import plots as draw
from pipeline.report import sections, texts
from pipeline.report.border import Case, cases, nearest
from pipeline.report.examples import Chosen, choose_pairs, choose_regions
from pipeline.report.page import Drawing, Film, Page
from pipeline.report.replays import draw_replay, most_telling_frame, render_replay
from pipeline.report.style import data_uri, svg

BORDER_CASES = 32


@dataclass(frozen=True)
class ReportData:
    """Everything the report reads. tests: search scenario -> rows of all its campaigns; searched: rows of those that versions learn from,
    round by round; detectors: version -> ONNX file.
    """

    measures: Measures
    white_box: WhiteBoxMeasures
    comparison: Comparison
    table: pd.DataFrame
    changes: pd.DataFrame
    regions: tuple[FailureRegions, ...]
    tests: Mapping[str, pd.DataFrame]
    searched: pd.DataFrame
    spaces: Mapping[str, Space]
    labels: Mapping[str, str]
    filters: Mapping[str, pd.DataFrame]
    cards: tuple[ModelCard, ...]
    detectors: Mapping[str, Path]
    border: tuple[Case, ...]


def border_cases(config: Config, filters: Mapping[str, pd.DataFrame], frames: Sequence[Path]) -> tuple[Case, ...]:
    """The frames nearest to the filter's border, of all strategies whose frames were filtered. frames: frames.parquet of each campaign."""
    judged = pd.concat(filters.values(), ignore_index=True)
    rows = nearest(judged, config.filter.min_visible_pixels, config.filter.min_detectability, BORDER_CASES)
    return tuple(cases(rows, frames))


def draw_figures(study: ReportData, strategies: Sequence[str], threshold_s: float) -> dict[str, Figure]:
    """Every figure of the report by the name of its file."""
    metrics = {card.version: card.metrics for card in study.cards}
    figures = {
        "comparison": draw.comparison_bars(study.comparison),
        "histogram": draw.kpi_histogram(study.table, study.comparison, threshold_s),
        "theta": draw.theta_curves(study.measures, study.labels),
        "coverage": draw.coverage_bars(study.measures, study.labels),
        "detection": draw.detection_bars(metrics, sections.METRICS),
        "reliability": draw.reliability_diagrams(study.cards),
        "border": draw.border_sheet(study.border),
    }
    if max(result.round for result in study.comparison.versions) > 1:
        figures["rounds"] = draw.failures_by_round(study.comparison)
    for regions in study.regions:
        name, tests = regions.scenario, study.tests[regions.scenario]
        figures[f"kpi_{name}"] = draw.kpi_scatter(tests, strategies, regions.label, threshold_s)
        figures[f"failures_{name}"] = draw.parallel_coordinates(tests, study.spaces[name], regions)
    return figures


def _drawing(figures: Mapping[str, Figure], name: str) -> Drawing:
    return Drawing(svg(figures[name]), texts.FIGURES[name.partition("_")[0]])


def make_page(config: Config, study: ReportData, figures: Mapping[str, Figure], progress: OnProgress) -> Page:
    """The page with its replays, which are re-simulated: the same test gives the same frames."""
    spaces = dict(study.spaces) | {name: config.space(name) for name in config.held_out}
    pair = choose_pairs(study.comparison, study.table, spaces)[: config.report.replays // 2 * 2]
    base = study.comparison.versions[0].version
    chosen = choose_regions(study.regions, base, config.report.replays - len(pair))
    films = film_all(config, [*pair, *chosen], study.detectors, spaces, progress)
    by_scenario: dict[str, list[Film]] = {}
    for test, film in zip(chosen, films[len(pair) :], strict=True):
        by_scenario.setdefault(test.scenario, []).append(film)
    kpi = [_drawing(figures, f"kpi_{name}") for name in study.labels]
    return Page(
        study=config.study,
        headline=sections.headline(study.comparison),
        sections=(
            sections.verdict_section(
                study.comparison,
                study.changes,
                [_drawing(figures, "comparison"), _drawing(figures, "histogram")],
                sections.rounds_part(study.searched, study.measures.confidence, [_drawing(figures, "rounds")])
                if "rounds" in figures
                else None,
                films[: len(pair)],
            ),
            sections.regions_section(study.regions, {name: _drawing(figures, f"failures_{name}") for name in study.labels}, by_scenario),
            sections.search_section(
                study.measures, study.white_box, study.labels, [_drawing(figures, "theta"), *kpi], [_drawing(figures, "coverage")]
            ),
            sections.data_section(
                study.filters,
                study.cards,
                [_drawing(figures, "border")],
                [_drawing(figures, "detection"), _drawing(figures, "reliability")],
            ),
        ),
    )


def film_all(
    config: Config, tests: Sequence[Chosen], detectors: Mapping[str, Path], spaces: Mapping[str, Space], progress: OnProgress
) -> list[Film]:
    """Re-simulate and film each test, in the order given; one simulator a scenario, one detector a version."""
    simulators: dict[str, Simulator] = {}
    loaded: dict[str, Detector] = {}
    films = []
    with tempfile.TemporaryDirectory() as folder:
        for done, test in enumerate(tests, 1):
            if test.scenario not in simulators:
                body: dict[str, Any] = config.scenarios[test.scenario].model_dump()
                simulators[test.scenario] = instantiate(config.simulator, scenario=body, _convert_="all")
            if test.version not in loaded:
                model = str(detectors[test.version])
                loaded[test.version] = instantiate(config.detector, model=model, _convert_="all")
            films.append(_film(config, test, simulators[test.scenario], loaded[test.version], spaces[test.scenario], Path(folder)))
            progress(done, len(tests), test.heading)
    return films


def _film(config: Config, test: Chosen, simulator: Simulator, detector: Detector, space: Space, folder: Path) -> Film:
    episode = simulator.execute(test.concrete, detector, keep_every=1)
    threshold_s, units = config.campaign.failure_threshold_s, {v.name: v.unit for v in space.variables}
    video, poster = folder / "replay.mp4", folder / "poster.jpg"
    render_replay(episode, test.heading, test.concrete, video, failure_threshold_s=threshold_s, units=units)
    still = draw_replay(episode, test.heading, test.concrete, failure_threshold_s=threshold_s, units=units)[most_telling_frame(episode)]
    cv2.imwrite(str(poster), cv2.cvtColor(still, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 80])
    return Film(test.heading, test.reason, data_uri(video, "video/mp4"), data_uri(poster, "image/jpeg"))
