"""From a study's results to the report: its figures, its replays and the page that holds them."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
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
from pipeline.report.data import ComparedVersions, ReportData
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


def border_cases(
    config: Config, filters: Mapping[str, pd.DataFrame], frames: Sequence[Path]
) -> tuple[Case, ...]:
    """The frames nearest to the filter's border, over all strategies. frames: frames.parquet of their campaigns."""
    if not filters:  # No version learns from tests.
        return ()
    judged = pd.concat(filters.values(), ignore_index=True)
    rows = nearest(
        judged, config.filter.min_visible_pixels, config.filter.min_detectability, BORDER_CASES
    )
    return tuple(cases(rows, frames))


def draw_figures(
    data: ReportData, strategies: Sequence[str], threshold_s: float
) -> dict[str, Figure]:
    """Every figure of the report by the name of its file. threshold_s: the adj. TTC of a failure."""
    figures = {
        "theta": search_plots.theta_curves(data.measures, data.labels),
        "coverage": search_plots.coverage_bars(data.measures, data.labels),
    }
    for regions in data.regions:
        name, tests = regions.scenario, data.tests[regions.scenario]
        figures[f"kpi_{name}"] = search_plots.kpi_scatter(
            tests, strategies, regions.label, threshold_s
        )
        figures[f"pairs_{name}"] = coverage_plots.pair_matrix(data.pairs[name], regions.label)
        figures[f"failures_{name}"] = search_plots.parallel_coordinates(
            tests, data.spaces[name], regions
        )
    if data.compared is not None:
        figures |= _comparison_figures(data.compared, threshold_s)
    if data.filters:
        figures["border"] = training_plots.border_sheet(data.border)
    if data.cards:
        metrics = {card.version: card.metrics for card in data.cards}
        figures["detection"] = training_plots.detection_bars(metrics, sections.METRICS)
    if data.reliability:
        figures["reliability"] = training_plots.reliability_diagrams(data.reliability)
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


def make_page(
    config: Config, data: ReportData, figures: Mapping[str, Figure], progress: OnProgress
) -> Page:
    """The page with its stills and replays, whose tests are simulated again."""
    spaces = dict(data.spaces) | {name: config.space(name) for name in config.held_out}
    drawings: dict[str, Drawing] = {}
    for done, (name, figure) in enumerate(figures.items(), 1):
        drawings[name] = _drawing(figure, name, data)
        progress(done, len(figures), f"figure {name}")
    fixes, pair = _changes(data.compared, spaces)
    budget = config.report.replays
    filmed = 2 if fixes and budget >= 2 else 0
    pair = pair if budget - filmed >= 2 else []
    chosen = choose_regions(data.regions, data.version, budget - filmed - len(pair))
    reruns = Reruns(
        config, partial(_detector, config, data), 2 * len(fixes) + len(pair) + len(chosen), progress
    )
    executed = [(fix, (reruns.execute(fix.before), reruns.execute(fix.after))) for fix in fixes]
    stills = [
        _stills(fix, episodes, config.campaign.failure_threshold_s)
        for fix, episodes in executed[1:]
    ]
    films = [
        _film(reruns, test, spaces[test.scenario], config.campaign.failure_threshold_s)
        for test in pair
    ]
    by_region: dict[str, list[Film]] = {}
    for test in chosen:
        film = _film(reruns, test, spaces[test.scenario], config.campaign.failure_threshold_s)
        by_region.setdefault(test.region, []).append(film)
    frames = KeptFrames(data.frames)
    found = [
        _verdict(data, drawings, stills, films),
        _regions(data, drawings, _cards(data, frames, by_region, config.threshold)),
        _search(data, drawings),
        sections.data_section(
            data.filters,
            data.cards,
            _named(drawings, "border"),
            _named(drawings, "detection", "reliability"),
        ),
    ]
    if data.calibrations:
        found.append(
            sections.calibration_section(
                tuple(data.calibrations.values()), _named(drawings, "reliability")
            )
        )
    every = data.every_test
    found.append(
        identity_section(every, data.every_label, data.cards, data.files, _settings(config))
    )
    title = (
        "Where does the detector fail, and did retraining help?"
        if data.cards
        else "Where does the detector fail?"
    )
    shown = tuple(section for section in found if section is not None)
    tested = set(every["scenario"])
    table = explorer(
        every,
        data.every_label,
        {name: space for name, space in spaces.items() if name in tested},
        data.regions,
        frames,
    )
    return Page(
        config.study,
        _headline(data),
        shown,
        title,
        table,
        _first(config, data, executed, bool(filmed)),
    )


def _first(
    config: Config, data: ReportData, executed: Sequence[tuple[Fix, Both]], filmed: bool
) -> FirstScreen | None:
    """The first fix, as films or as stills; words if there is none, and nothing if no versions are compared."""
    if data.compared is None:
        return None
    if not executed:
        return no_fix(data.compared.comparison.versions[0])
    (fix, episodes), threshold_s = executed[0], config.campaign.failure_threshold_s
    scenario, space = config.scenarios[fix.before.scenario], config.space(fix.before.scenario)
    where = f"{scenario.label}: {scenario.description.partition('. ')[0].removesuffix('.')}."
    if not filmed:
        return first_screen(
            where, fix.before.concrete, space, stills=_stills(fix, episodes, threshold_s)
        )
    both = zip((fix.before, fix.after), episodes, strict=True)
    return first_screen(
        where,
        fix.before.concrete,
        space,
        [drive(one.test_id, one.version, episode, threshold_s) for one, episode in both],
    )


def _settings(config: Config) -> list[tuple[str, str]]:
    """The settings that decide what fails, as in params.yaml."""
    judged = {
        "campaign.failure_threshold_s": config.campaign.failure_threshold_s,
        "campaign.match_iou": config.campaign.match_iou,
    }
    sections = {
        "detector": config.detector,
        "simulator": config.simulator,
        "aeb": config.aeb.model_dump(),
        "vehicle": config.vehicle.model_dump(),
    }
    flat = {
        f"{name}.{key}": value
        for name, section in sections.items()
        for key, value in section.items()
    }
    return [
        (key, value if isinstance(value, str) else json.dumps(value))
        for key, value in (judged | flat).items()
    ]


def _detector(config: Config, data: ReportData, version: str) -> Detector:
    """A version's detector, calibrated as in its tests."""
    return make_detector(
        as_tested(config.detector, data.calibrations.get(version)), data.detectors[version]
    )


def _changes(
    compared: ComparedVersions | None, spaces: Mapping[str, Space]
) -> tuple[list[Fix], list[Chosen]]:
    """Tests whose outcome retraining changed: the fixes, and a regression with both versions."""
    if compared is None:
        return [], []
    found = compared.comparison, compared.tests, spaces
    return choose_fixes(*found, FIXES), choose_regression(*found)


def _headline(data: ReportData) -> str:
    if data.compared is not None:
        return " ".join(
            [
                verdict_section.headline(data.compared.comparison),
                *sections.largest_regions(data.regions),
            ]
        )
    return sections.headline(data.regions, data.measures.base_rates)


def _verdict(
    data: ReportData,
    drawings: Mapping[str, Drawing],
    stills: Sequence[BeforeAfter],
    films: Sequence[Film],
) -> Section | None:
    if data.compared is None:
        return None
    rounds = (
        verdict_section.rounds_part(data.learnt, [drawings["rounds"]])
        if "rounds" in drawings
        else None
    )
    plots = _named(drawings, "comparison", "histogram")
    return verdict_section.verdict_section(
        data.compared.comparison, data.compared.named_changes, plots, rounds, stills, films
    )


def _cards(
    data: ReportData, frames: KeptFrames, films: Mapping[str, Sequence[Film]], reported_from: float
) -> dict[str, tuple[Card, ...]]:
    """The cards of each scenario. films: by region."""
    tests = {regions.scenario: pictured(regions, frames) for regions in data.regions}
    wanted = {test for chosen in tests.values() for some in chosen.values() for test in some}
    rows = pd.concat(data.tests.values())
    shown = Shown(
        frames.moments(wanted), ends(rows[rows["test_id"].isin(wanted)]), films, reported_from
    )
    return {
        regions.scenario: cards(regions, tests[regions.scenario], shown) for regions in data.regions
    }


def _regions(
    data: ReportData, drawings: Mapping[str, Drawing], found: Mapping[str, Sequence[Card]]
) -> Section:
    plots = {name: drawings[f"failures_{name}"] for name in data.labels}
    return sections.regions_section(data.regions, data.measures.base_rates, plots, found)


def _search(data: ReportData, drawings: Mapping[str, Drawing]) -> Section:
    plots = _named(drawings, "theta", *(f"kpi_{name}" for name in data.labels))
    covered = _named(drawings, "coverage", *(f"pairs_{name}" for name in data.labels))
    return sections.search_section(
        data.measures, data.white_box, data.labels, plots, covered, data.pairs
    )


def _drawing(figure: Figure, name: str, data: ReportData) -> Drawing:
    kind = name.partition("_")[0]
    words = [texts.FIGURES[kind]]
    if any(len(row.seeds) > 1 for row in data.measures.strategies):
        words += filter(None, [texts.SEARCHES.get(kind)])
    if data.compared is not None and data.compared.comparison.seeds > 1:
        words += filter(None, [texts.TRAININGS.get(kind)])
    return Drawing.of(figure, " ".join(words))


def _named(drawings: Mapping[str, Drawing], *names: str) -> list[Drawing]:
    """Those that there are."""
    return [drawings[name] for name in names if name in drawings]


def _stills(fix: Fix, episodes: Both, threshold_s: float) -> BeforeAfter:
    heading, _, _ = fix.before.heading.rpartition(" · ")
    values = (group.rpartition(" = ")[2] for group in fix.groups)
    return before_after(
        f"{heading}: {', '.join(values)}",
        (fix.before.version, fix.after.version),
        episodes,
        threshold_s,
    )


def _film(reruns: Reruns, test: Chosen, space: Space, threshold_s: float) -> Film:
    episode = reruns.execute(test)
    replay = Replay(episode, test.heading, test.concrete, threshold_s, space.units)
    with tempfile.TemporaryDirectory() as folder:
        video = Path(folder) / "replay.mp4"
        render_replay(replay, video)
        return Film(
            test.test_id,
            test.heading,
            test.reason,
            data_uri(video.read_bytes(), "video/mp4"),
            jpeg_uri(draw_replay(replay)[most_telling_frame(episode)]),
        )
