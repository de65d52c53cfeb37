"""From a study's results to the report: its figures, its replays and the page that holds them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import cv2
import pandas as pd
from matplotlib.figure import Figure

from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.model_card import ModelCard
from pipeline.artefacts.results import FailureRegions, Measures, WhiteBoxMeasures
from pipeline.config.components import make_detector, make_simulator
from pipeline.config.schema import Config
from pipeline.core.space import Space
from pipeline.detectors.calibrated import calibrated
from pipeline.progress import OnProgress
from pipeline.protocols import Detector, Simulator
from pipeline.report import comparison_plots, search_plots, sections, texts, training_plots, verdict_section
from pipeline.report.border import Case, cases, nearest
from pipeline.report.examples import Chosen, choose_pairs, choose_regions
from pipeline.report.page import Drawing, Film, Page, Section
from pipeline.report.replays import Replay, draw_replay, most_telling_frame, render_replay
from pipeline.report.style import data_uri, svg

BORDER_CASES = 32


@dataclass(frozen=True)
class ComparedVersions:
    """The comparison, the rows of comparison.parquet and those of changes.csv."""

    comparison: Comparison
    tests: pd.DataFrame
    changes: pd.DataFrame


@dataclass(frozen=True)
class ReportData:
    """Everything that a report shows; a section whose data are None or empty is left out.

    tests: search scenario -> rows of all its campaigns. searched: rows of the campaigns that versions learn from, round by round.
    detectors: version -> ONNX file, the searched version first. filters: strategy -> its filter table. border: frames at the border of
    the filters. calibrations: of detectors that are only tested, if the study calibrates them.
    """

    measures: Measures
    regions: tuple[FailureRegions, ...]
    tests: Mapping[str, pd.DataFrame]
    spaces: Mapping[str, Space]
    labels: Mapping[str, str]
    detectors: Mapping[str, Path]
    white_box: WhiteBoxMeasures | None
    compared: ComparedVersions | None
    searched: pd.DataFrame
    filters: Mapping[str, pd.DataFrame]
    cards: tuple[ModelCard, ...]
    border: tuple[Case, ...]
    calibrations: Mapping[str, DetectorCalibration] = field(default_factory=dict)


def border_cases(config: Config, filters: Mapping[str, pd.DataFrame], frames: Sequence[Path]) -> tuple[Case, ...]:
    """The frames nearest to the filter's border, over all strategies. frames: frames.parquet of their campaigns."""
    judged = pd.concat(filters.values(), ignore_index=True)
    rows = nearest(judged, config.filter.min_visible_pixels, config.filter.min_detectability, BORDER_CASES)
    return tuple(cases(rows, frames))


def draw_figures(data: ReportData, strategies: Sequence[str], threshold_s: float) -> dict[str, Figure]:
    """Every figure of the report by the name of its file. threshold_s: the adj. TTC of a failure."""
    figures = {
        "theta": search_plots.theta_curves(data.measures, data.labels),
        "coverage": search_plots.coverage_bars(data.measures, data.labels),
    }
    for regions in data.regions:
        name, tests = regions.scenario, data.tests[regions.scenario]
        figures[f"kpi_{name}"] = search_plots.kpi_scatter(tests, strategies, regions.label, threshold_s)
        figures[f"failures_{name}"] = search_plots.parallel_coordinates(tests, data.spaces[name], regions)
    if data.compared is not None:
        figures |= _comparison_figures(data.compared, threshold_s)
    if data.filters:
        figures["border"] = training_plots.border_sheet(data.border)
    if data.cards:
        metrics = {card.version: card.metrics for card in data.cards}
        figures["detection"] = training_plots.detection_bars(metrics, sections.METRICS)
        figures["reliability"] = training_plots.reliability_diagrams({card.version: card.reliability for card in data.cards})
    if data.calibrations:
        diagrams = {version: found.reliability for version, found in data.calibrations.items()}
        figures["reliability"] = training_plots.reliability_diagrams(diagrams)
    return figures


def _comparison_figures(compared: ComparedVersions, threshold_s: float) -> dict[str, Figure]:
    comparison = compared.comparison
    figures = {
        "comparison": comparison_plots.comparison_bars(comparison),
        "histogram": comparison_plots.kpi_histogram(compared.tests, comparison, threshold_s),
    }
    if max(result.round for result in comparison.versions) > 1:
        figures["rounds"] = comparison_plots.failures_by_round(comparison)
    return figures


def make_page(config: Config, data: ReportData, figures: Mapping[str, Figure], progress: OnProgress) -> Page:
    """The page with its replays, which are simulated again: the same test gives the same frames."""
    spaces = dict(data.spaces) | {name: config.space(name) for name in config.held_out}
    pair = _pair(data.compared, spaces)[: config.report.replays // 2 * 2]
    chosen = choose_regions(data.regions, next(iter(data.detectors)), config.report.replays - len(pair))
    films = film_all(config, [*pair, *chosen], partial(_detector, config, data), spaces, progress)
    by_scenario: dict[str, list[Film]] = {}
    for test, film in zip(chosen, films[len(pair) :], strict=True):
        by_scenario.setdefault(test.scenario, []).append(film)
    drawings = {name: _drawing(figure, name) for name, figure in figures.items()}
    found = [
        _verdict(data, drawings, films[: len(pair)]),
        _regions(data, drawings, by_scenario),
        _search(data, drawings),
        sections.data_section(data.filters, data.cards, _named(drawings, "border"), _named(drawings, "detection", "reliability")),
    ]
    if data.calibrations:
        found.append(sections.calibration_section(tuple(data.calibrations.values()), _named(drawings, "reliability")))
    title = "Where does the detector fail, and did retraining help?" if data.cards else "Where does the detector fail?"
    return Page(config.study, _headline(data), tuple(section for section in found if section is not None), title)


def _detector(config: Config, data: ReportData, version: str) -> Detector:
    """A version's detector, calibrated as in its tests."""
    known = data.calibrations.get(version)
    section = config.detector if known is None else calibrated(config.detector, known.scaling)
    return make_detector(section, data.detectors[version])


def _pair(compared: ComparedVersions | None, spaces: Mapping[str, Space]) -> list[Chosen]:
    return [] if compared is None else choose_pairs(compared.comparison, compared.tests, spaces)


def _headline(data: ReportData) -> str:
    if data.compared is not None:
        return verdict_section.headline(data.compared.comparison)
    return sections.headline(data.regions, data.measures.base_rates)


def _verdict(data: ReportData, drawings: Mapping[str, Drawing], films: Sequence[Film]) -> Section | None:
    if data.compared is None:
        return None
    rounds = verdict_section.rounds_part(data.searched, [drawings["rounds"]]) if "rounds" in drawings else None
    plots = _named(drawings, "comparison", "histogram")
    return verdict_section.verdict_section(data.compared.comparison, data.compared.changes, plots, rounds, films)


def _regions(data: ReportData, drawings: Mapping[str, Drawing], films: Mapping[str, Sequence[Film]]) -> Section:
    plots = {name: drawings[f"failures_{name}"] for name in data.labels}
    return sections.regions_section(data.regions, data.measures.base_rates, plots, films)


def _search(data: ReportData, drawings: Mapping[str, Drawing]) -> Section:
    plots = _named(drawings, "theta", *(f"kpi_{name}" for name in data.labels))
    return sections.search_section(data.measures, data.white_box, data.labels, plots, _named(drawings, "coverage"))


def _drawing(figure: Figure, name: str) -> Drawing:
    return Drawing(svg(figure), texts.FIGURES[name.partition("_")[0]])


def _named(drawings: Mapping[str, Drawing], *names: str) -> list[Drawing]:
    """Those that there are."""
    return [drawings[name] for name in names if name in drawings]


def film_all(
    config: Config,
    tests: Sequence[Chosen],
    detector_of: Callable[[str], Detector],
    spaces: Mapping[str, Space],
    progress: OnProgress,
) -> list[Film]:
    """Simulate each test again and film it, in the order given; one simulator a scenario, one detector a version."""
    simulators: dict[str, Simulator] = {}
    loaded: dict[str, Detector] = {}
    films = []
    with tempfile.TemporaryDirectory() as folder:
        for done, test in enumerate(tests, 1):
            if test.scenario not in simulators:
                simulators[test.scenario] = make_simulator(config.simulator, config.scenarios[test.scenario], config.car)
            if test.version not in loaded:
                loaded[test.version] = detector_of(test.version)
            episode = simulators[test.scenario].execute(test.concrete, loaded[test.version], keep_every=1)
            units = {variable.name: variable.unit for variable in spaces[test.scenario].variables}
            replay = Replay(episode, test.heading, test.concrete, config.campaign.failure_threshold_s, units)
            films.append(_film(replay, test.reason, Path(folder)))
            progress(done, len(tests), test.heading)
    return films


def _film(replay: Replay, reason: str, folder: Path) -> Film:
    video, poster = folder / "replay.mp4", folder / "poster.jpg"
    render_replay(replay, video)
    still = draw_replay(replay)[most_telling_frame(replay.episode)]
    cv2.imwrite(str(poster), cv2.cvtColor(still, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 80])
    return Film(replay.title, reason, data_uri(video, "video/mp4"), data_uri(poster, "image/jpeg"))
