"""The contents of the report: figures, replays and the page that holds them."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from pipeline.config.components import make_detector
from pipeline.config.schema import Config
from pipeline.core.episode import Episode
from pipeline.core.space import Space
from pipeline.detectors.calibrated import as_tested
from pipeline.progress import OnProgress
from pipeline.protocols import Detector
from pipeline.report import (
    comparison_plots,
    coverage_plots,
    search_plots,
    sections,
    texts,
    training_plots,
    verdict_section,
)
from pipeline.report.before_after import before_after
from pipeline.report.border import Case, cases, nearest
from pipeline.report.data import ReportData
from pipeline.report.examples import Chosen, Fix, choose_fixes, choose_regions, choose_regression
from pipeline.report.explorer import explorer
from pipeline.report.first_screen import drive, first_screen, no_fix
from pipeline.report.identity_section import identity_section
from pipeline.report.kept_frames import KeptFrames
from pipeline.report.page import BeforeAfter, Card, Drawing, Film, FirstScreen, Page, Section
from pipeline.report.region_cards import Shown, cards, ends, pictured
from pipeline.report.replays import Replay, draw_replay, jpeg_uri, most_telling_frame, render_replay
from pipeline.report.reruns import Reruns
from pipeline.report.style import data_uri

BORDER_CASES = 32
FIXES = 3
"""Fixes shown, the first one on the first screen."""
Both = tuple[Episode, Episode]
"""Of the version before and the version after."""


def border_cases(
    config: Config, filters: Mapping[str, pd.DataFrame], frames: Sequence[Path]
) -> tuple[Case, ...]:
    """The frames nearest to the filter's thresholds, over all strategies.

    Args:
        config: The study's configuration.
        filters: Strategy -> its filter table; empty if no version learns from tests.
        frames: frames.parquet of the campaigns.
    """
    if not filters:
        return ()
    judged = pd.concat(filters.values(), ignore_index=True)
    section = config.filter
    rows = nearest(judged, section.min_visible_pixels, section.min_detectability, BORDER_CASES)
    return tuple(cases(rows, frames))


def draw_figures(
    data: ReportData, strategies: Sequence[str], threshold_s: float
) -> dict[str, Figure]:
    """Every figure of the report, by the name of its file.

    Args:
        data: Contents of the report.
        strategies: Strategies of the search, in the order of their panels.
        threshold_s: Adj. TTC at or below which a test fails.
    """
    figures = {
        "theta": search_plots.theta_curves(data.measures, data.labels),
        "coverage": search_plots.coverage_bars(data.measures, data.labels),
    }
    for regions in data.regions:
        name, label = regions.scenario, regions.label
        tests = data.tests[name]
        figures[f"kpi_{name}"] = search_plots.kpi_scatter(tests, strategies, label, threshold_s)
        figures[f"pairs_{name}"] = coverage_plots.pair_matrix(data.pairs[name], label)
        lines = search_plots.parallel_coordinates(tests, data.spaces[name], regions)
        figures[f"failures_{name}"] = lines
    if data.compared is not None:
        comparison, table = data.compared.comparison, data.compared.tests
        figures["comparison"] = comparison_plots.comparison_bars(comparison)
        figures["histogram"] = comparison_plots.kpi_histogram(table, comparison, threshold_s)
        if max(result.round for result in comparison.versions) > 1:
            figures["rounds"] = comparison_plots.failures_by_round(comparison)
    if data.filters:
        figures["border"] = training_plots.border_sheet(data.border)
    if data.cards:
        metrics = {card.version: card.metrics for card in data.cards}
        figures["detection"] = training_plots.detection_bars(metrics, sections.METRICS)
    if data.reliability:
        figures["reliability"] = training_plots.reliability_diagrams(data.reliability)
    return figures


def make_page(
    config: Config, data: ReportData, figures: Mapping[str, Figure], progress: OnProgress
) -> Page:
    """The page with its stills and replays, for which tests are executed again.

    Args:
        config: The study's configuration.
        data: Contents of the report.
        figures: Figures from `draw_figures`.
        progress: Called after each figure and each executed test.
    """
    threshold_s = config.campaign.failure_threshold_s
    spaces = dict(data.spaces) | {name: config.space(name) for name in config.held_out}
    drawings: dict[str, Drawing] = {}
    for done, (name, figure) in enumerate(figures.items(), 1):
        drawings[name] = _drawing(figure, name, data)
        progress(done, len(figures), f"figure {name}")
    fixes: list[Fix] = []
    regression: list[Chosen] = []
    if data.compared is not None:
        changed = data.compared.comparison, data.compared.tests, spaces
        fixes, regression = choose_fixes(*changed, FIXES), choose_regression(*changed)
    budget = config.report.replays
    filmed = 2 if fixes and budget >= 2 else 0
    if budget - filmed < 2:
        regression = []
    chosen = choose_regions(data.regions, data.version, budget - filmed - len(regression))

    def detector(version: str) -> Detector:
        """A version's detector, calibrated as in its tests."""
        settings = as_tested(config.detector, data.calibrations.get(version))
        return make_detector(settings, data.detectors[version])

    total = 2 * len(fixes) + len(regression) + len(chosen)
    reruns = Reruns(config, detector, total, progress)
    executed = [(fix, (reruns.execute(fix.before), reruns.execute(fix.after))) for fix in fixes]
    stills = [_stills(fix, episodes, threshold_s) for fix, episodes in executed[1:]]
    films = [_film(reruns, test, spaces[test.scenario], threshold_s) for test in regression]
    by_region: dict[str, list[Film]] = {}
    for test in chosen:
        film = _film(reruns, test, spaces[test.scenario], threshold_s)
        by_region.setdefault(test.region, []).append(film)
    frames, every = KeptFrames(data.frames), data.every_test
    region_cards = _cards(data, frames, by_region, config.threshold)
    shown = _sections(data, drawings, stills, films, region_cards)
    shown.append(
        identity_section(every, data.every_label, data.cards, data.files, _settings(config))
    )
    executed_in = set(every["scenario"])
    tested = {name: space for name, space in spaces.items() if name in executed_in}
    headline = sections.headline(data.regions, data.measures.base_rates)
    if data.compared is not None:
        verdict = verdict_section.headline(data.compared.comparison)
        headline = " ".join([verdict, *sections.largest_regions(data.regions)])
    question = ", and did retraining help?" if data.cards else "?"
    return Page(
        config.study,
        headline,
        tuple(shown),
        f"Where does the detector fail{question}",
        explorer(every, data.every_label, tested, data.regions, frames),
        _first(config, data, executed, bool(filmed)),
    )


def _drawing(figure: Figure, name: str, data: ReportData) -> Drawing:
    """A figure and how to read it, given the seeds of the searches and trainings."""
    kind = name.partition("_")[0]
    words = [texts.FIGURES[kind]]
    if any(len(row.seeds) > 1 for row in data.measures.strategies):
        words.append(texts.SEARCHES.get(kind, ""))
    if data.compared is not None and data.compared.comparison.seeds > 1:
        words.append(texts.TRAININGS.get(kind, ""))
    return Drawing.of(figure, " ".join(filter(None, words)))


def _sections(
    data: ReportData,
    drawings: Mapping[str, Drawing],
    stills: Sequence[BeforeAfter],
    films: Sequence[Film],
    region_cards: Mapping[str, Sequence[Card]],
) -> list[Section]:
    """The sections on the verdict, the regions, the search and the training, without empty ones."""

    def named(*names: str) -> list[Drawing]:
        return [drawings[name] for name in names if name in drawings]

    result = []
    if data.compared is not None:
        rounds = named("rounds")
        section = verdict_section.verdict_section(
            data.compared.comparison,
            data.compared.named_changes,
            named("comparison", "histogram"),
            verdict_section.rounds_part(data.learnt, rounds) if rounds else None,
            stills,
            films,
        )
        result.append(section)
    lines = {name: drawings[f"failures_{name}"] for name in data.labels}
    rates = data.measures.base_rates
    result.append(sections.regions_section(data.regions, rates, lines, region_cards))
    plots = named("theta", *(f"kpi_{name}" for name in data.labels))
    coverage = named("coverage", *(f"pairs_{name}" for name in data.labels))
    search = sections.search_section(
        data.measures, data.white_box, data.labels, plots, coverage, data.pairs
    )
    result.append(search)
    detection = named("detection", "reliability")
    training = sections.data_section(data.filters, data.cards, named("border"), detection)
    if training is not None:
        result.append(training)
    if data.calibrations:
        calibrations = tuple(data.calibrations.values())
        result.append(sections.calibration_section(calibrations, named("reliability")))
    return result


def _first(
    config: Config, data: ReportData, executed: Sequence[tuple[Fix, Both]], filmed: bool
) -> FirstScreen | None:
    """The first fix, as films or stills, or why there is none; None if no versions are compared."""
    if data.compared is None:
        return None
    if not executed:
        return no_fix(data.compared.comparison.versions[0])
    (fix, episodes), threshold_s = executed[0], config.campaign.failure_threshold_s
    scenario, space = config.scenarios[fix.before.scenario], config.space(fix.before.scenario)
    where = f"{scenario.label}: {scenario.description.partition('. ')[0].removesuffix('.')}."
    if not filmed:
        stills = _stills(fix, episodes, threshold_s)
        return first_screen(where, fix.before.concrete, space, stills=stills)
    films = []
    for test, episode in zip((fix.before, fix.after), episodes, strict=True):
        films.append(drive(test.test_id, test.version, episode, threshold_s))
    return first_screen(where, fix.before.concrete, space, films)


def _settings(config: Config) -> list[tuple[str, str]]:
    """The settings that decide what fails, as in params.yaml."""
    judged = ("failure_threshold_s", "match_iou")
    groups = {
        "campaign": {name: getattr(config.campaign, name) for name in judged},
        "detector": config.detector,
        "simulator": config.simulator,
        "aeb": config.aeb.model_dump(),
        "vehicle": config.vehicle.model_dump(),
    }
    rows = []
    for name, section in groups.items():
        for key, value in section.items():
            text = value if isinstance(value, str) else json.dumps(value)
            rows.append((f"{name}.{key}", text))
    return rows


def _cards(
    data: ReportData, frames: KeptFrames, films: Mapping[str, Sequence[Film]], reported_from: float
) -> dict[str, tuple[Card, ...]]:
    """The cards of each scenario. films: by region. reported_from: lowest reported score."""
    tests = {regions.scenario: pictured(regions, frames) for regions in data.regions}
    wanted: set[str] = set()
    for by_card in tests.values():
        wanted.update(*by_card.values())
    rows = pd.concat(data.tests.values())
    how_ended = ends(rows[rows["test_id"].isin(wanted)])
    shown = Shown(frames.moments(wanted), how_ended, films, reported_from)
    return {r.scenario: cards(r, tests[r.scenario], shown) for r in data.regions}


def _stills(fix: Fix, episodes: Both, threshold_s: float) -> BeforeAfter:
    heading, _, _ = fix.before.heading.rpartition(" · ")
    values = (group.rpartition(" = ")[2] for group in fix.groups)
    versions = (fix.before.version, fix.after.version)
    return before_after(f"{heading}: {', '.join(values)}", versions, episodes, threshold_s)


def _film(reruns: Reruns, test: Chosen, space: Space, threshold_s: float) -> Film:
    """Execute a test again and film it."""
    episode = reruns.execute(test)
    replay = Replay(episode, test.heading, test.concrete, threshold_s, space.units)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "replay.mp4"
        render_replay(replay, path)
        video = data_uri(path.read_bytes(), "video/mp4")
    poster = jpeg_uri(draw_replay(replay)[most_telling_frame(episode)])
    return Film(test.test_id, test.heading, test.reason, video, poster)
