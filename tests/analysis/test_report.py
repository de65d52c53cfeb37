"""The report page of a fabricated study, with replays by the analytic simulator."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.container import ErrorbarContainer

from pipeline.analysis.pair_shares import pair_shares
from pipeline.artefacts.comparison_results import Comparison, PlantedGroup
from pipeline.artefacts.files import sha256
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.model_card import read_card
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import Estimate, read
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.tables import read_tests
from pipeline.config.composing import compose
from pipeline.core.loop import run_test
from pipeline.core.measures import pair_coverage
from pipeline.core.space import Space, Variable
from pipeline.detectors.scripted import VisiblePixelOracle
from pipeline.report import sections, texts
from pipeline.report.border import nearest
from pipeline.report.comparison_plots import failures_by_round, kpi_histogram
from pipeline.report.contents import border_cases, draw_figures, make_page
from pipeline.report.data import ReportData
from pipeline.report.examples import choose_fixes, choose_regions, choose_regression
from pipeline.report.failure_tables import CAUSES, rate_text
from pipeline.report.first_screen import STRIP_HEIGHT, draw_drive, no_fix, person
from pipeline.report.page import Drawing, Page, render
from pipeline.report.replays import draw_view
from pipeline.report.search_plots import kpi_scatter
from pipeline.report.style import MODE_NAMES, panels, save_png, styled, svg
from pipeline.report.verdict_section import headline, rounds_part, verdict_section
from pipeline.simulators.analytic import AnalyticWorld
from pipeline.testing import CAR
from tests.analysis.fabricated import FabricatedStudy

LOADING = {"src", "href", "poster", "xlink:href", "data", "srcset", "action"}


class Loads(HTMLParser):
    """Collects every address that a page loads or links to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in LOADING]
        assert tag not in {"iframe", "link", "base", "object", "embed"}


def make(study: FabricatedStudy, replays: int) -> str:
    section = study.config.report.model_copy(update={"replays": replays})
    replace(study, config=study.config.model_copy(update={"report": section})).run("report")
    return (study.root / "report.html").read_text()


def without_scripts(text: str) -> str:
    return re.sub(r"<(script|style)\b.*?</\1>", "", text, flags=re.DOTALL)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> FabricatedStudy:
    return FabricatedStudy(tmp_path_factory.mktemp("study")).make_analysed()


@pytest.fixture(scope="module")
def whole(study: FabricatedStudy) -> str:
    return make(study, replays=3)


@pytest.fixture(scope="module")
def page(whole: str) -> str:
    return without_scripts(whole).replace("\u00a0", " ")


def test_page_loads_nothing(whole: str, page: str) -> None:
    addresses = Loads(whole).addresses
    assert all(address.startswith(("#", "data:")) for address in addresses)
    assert sum(address.startswith("data:video/mp4;base64,") for address in addresses) == 3
    assert "url(http" not in page
    assert "@import" not in page
    policy = re.search(r'<meta http-equiv="Content-Security-Policy" content="([^"]+)">', page)
    assert policy and policy.start() < whole.index("<style")
    allowed = {words[0]: words[1:] for words in map(str.split, policy[1].split(";"))}
    assert [allowed[name] for name in ("default-src", "base-uri", "form-action")] == [
        ["'none'"]
    ] * 3
    assert {source for sources in allowed.values() for source in sources} == {
        "'none'",
        "'unsafe-inline'",
        "data:",
    }


def test_page_says_what_the_artefacts_say(study: FabricatedStudy, page: str) -> None:
    comparison = read(study.root / "comparison.json", Comparison)
    for result in comparison.versions:
        assert f">{result.failures} / {result.tests}<" in page
    for path in study.regions:
        for region in read(path, FailureRegions).regions:
            assert region.rule.replace(">", "&gt;").replace("<", "&lt;") in page
    assert "adaptive ★" in page
    assert "None" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)
    assert "nan" not in re.sub(r"data:[^\"]*|<svg.*?</svg>", "", page, flags=re.DOTALL)


def test_page_says_causes_base_failure_rate_and_base_set(study: FabricatedStudy, page: str) -> None:
    measures = read(study.root / "measures.json", Measures)
    assert page.count("Failures by cause</h3>") == 2
    for name in CAUSES.values():
        assert f"<th>{name}</th>" in page
    for rate in measures.base_rates:
        assert page.count(rate_text(rate)) >= 4, "headline, verdict, regions and search"
    assert "baseline, unknown base set" in page and "its card does not say" in page
    assert "Unnecessary braking</h3>" not in page


def test_page_shows_the_limits_of_the_gate(study: FabricatedStudy, page: str) -> None:
    comparison = read(study.root / "comparison.json", Comparison)
    limits = comparison.versions[1].limits
    assert [limit.name for limit in limits[:2]] == ["F1*", "animation = walking"] and limits[
        -2
    ].name == "night"
    assert f"by scenario and group ({len(limits)})</summary>" in page
    for limit in limits:
        assert f">{limit.name}</td>" in re.sub(r">\s+", ">", page)


def test_unnecessary_braking_has_a_table_where_it_is_asked_for(study: FabricatedStudy) -> None:
    measures = read(study.root / "measures.json", Measures).model_copy(
        update={"no_braking": ("F2",)}
    )
    parts = sections.search_section(measures, None, {"F1": "F1", "F2": "F2"}, [], [], {}).parts
    table = next(part.table for part in parts if part.title == "Unnecessary braking")
    assert table is not None and [row[:3] for row in table.rows] == [
        ("base", "F2", name) for name in study.config.strategies
    ]


def test_same_study_gives_the_same_page(study: FabricatedStudy, whole: str) -> None:
    assert make(study, replays=3) == whole


def test_plots_are_written(study: FabricatedStudy, page: str) -> None:
    assert page
    names = {path.name for path in (study.root / "plots").iterdir()}
    kinds = {"comparison", "histogram", "reliability", "border", "theta", "coverage", "detection"}
    kinds |= {f"{kind}_{name}" for kind in ("kpi", "pairs", "failures") for name in ("F1", "F2")}
    assert names == {f"{kind}.png" for kind in kinds}


def test_replays_are_shared_among_regions(study: FabricatedStudy) -> None:
    scenarios = [read(path, FailureRegions) for path in study.regions]
    chosen = choose_regions(scenarios, "base", 4)
    assert [test.scenario for test in chosen] == ["F1", "F2", "F1", "F2"]
    assert "most typical" in chosen[0].reason and chosen[0].region == scenarios[0].regions[0].name
    assert choose_regions(scenarios, "base", 0) == []


def test_a_regression_of_the_champion_is_shown_with_both_versions(study: FabricatedStudy) -> None:
    comparison = read(study.root / "comparison.json", Comparison)
    table, spaces = (
        read_tests(study.root / "comparison.parquet"),
        {"F1star": study.config.space("F1star")},
    )
    assert choose_regression(comparison, table, spaces) == [], "the fabricated champion has none"
    champion = next(v for v in comparison.versions if v.version == comparison.champion)
    assert champion.paired is not None
    worse = champion.paired.model_copy(update={"regressions": champion.paired.fixes[1:2]})
    changed = comparison.model_copy(
        update={"versions": (comparison.versions[0], champion.model_copy(update={"paired": worse}))}
    )
    before, after = choose_regression(changed, table, spaces)
    assert (before.version, after.version) == ("base", comparison.champion)
    assert before.concrete == after.concrete
    assert after.reason == f"A regression of {comparison.champion} on a held-out test."
    same = comparison.model_copy(update={"versions": comparison.versions[:1]})
    assert choose_regression(same, table, {}) == []


def test_fixes_show_rare_groups_first_and_then_other_groups(study: FabricatedStudy) -> None:
    comparison = read(study.root / "comparison.json", Comparison)
    table, spaces = (
        read_tests(study.root / "comparison.parquet"),
        {"F1star": study.config.space("F1star")},
    )
    fixes = choose_fixes(comparison, table, spaces, 3)
    assert len(fixes) == 3 and len({fix.before.heading for fix in fixes}) == 3
    rare = next(
        group
        for fix in choose_fixes(comparison, table, spaces, 99)
        for group in fix.groups
        if group not in fixes[0].groups
    )
    planted = PlantedGroup(group=rare, frequency=0.15, searched={}, regions=(), held_out={})
    assert (
        rare
        in choose_fixes(comparison.model_copy(update={"planted": (planted,)}), table, spaces, 3)[
            0
        ].groups
    )
    for fix in fixes:
        assert (fix.before.version, fix.after.version) == (
            "base",
            comparison.champion,
        ) and fix.before.concrete == fix.after.concrete
        assert f"animation = {fix.before.concrete['animation']}" in fix.groups
    assert choose_fixes(comparison, table, spaces, 1) == fixes[:1]
    assert (
        choose_fixes(
            comparison.model_copy(update={"versions": comparison.versions[:1]}), table, spaces, 3
        )
        == []
    )


def test_fixes_of_the_next_version_are_shown_if_the_best_has_none(study: FabricatedStudy) -> None:
    comparison = read(study.root / "comparison.json", Comparison)
    table, spaces = (
        read_tests(study.root / "comparison.parquet"),
        {"F1star": study.config.space("F1star")},
    )
    base, best, *_ = sorted(
        comparison.versions,
        key=lambda version: (version.paired is not None, version.version != comparison.champion),
    )
    assert best.paired is not None
    worse = best.paired.model_copy(
        update={"version": "control", "fixes": (), "regressions": best.paired.fixes[:1]}
    )
    control = best.model_copy(
        update={"version": "control", "failures": best.failures - 1, "paired": worse}
    )
    both = comparison.model_copy(update={"versions": (base, control, best), "champion": "base"})
    assert [fix.after.version for fix in choose_fixes(both, table, spaces, 1)] == [best.version]
    assert [chosen.version for chosen in choose_regression(both, table, spaces)] == [
        "base",
        "control",
    ]


def test_first_screen_shows_a_person_a_place_and_both_films(
    study: FabricatedStudy, page: str
) -> None:
    first = page.partition("<main>")[0]
    comparison = read(study.root / "comparison.json", Comparison)
    fix = choose_fixes(
        comparison,
        read_tests(study.root / "comparison.parquet"),
        {"F1star": study.config.space("F1star")},
        1,
    )[0]
    assert first.count("<video ") == 2 and first.index(fix.before.test_id) < first.index(
        fix.after.test_id
    )
    assert re.search(
        rf"<strong>An? {fix.before.concrete['animation']} (child|adult)[^.]*\. F1\*: Suburban "
        r"street with a bus station",
        first,
    )
    assert f"fog {fix.before.concrete['fog']:.3g} %" in first
    assert page.partition("Planted blind spots")[0].count("<img src=") == 4, (
        "two more fixes as stills"
    )


@pytest.mark.parametrize(
    ("worn", "phrase"),
    [
        ({"hat": 1.0, "bag": 1.0}, "A crouching person with a hat and a bag"),
        ({"umbrella": 1.0, "bag": 1.0}, "A crouching person under an umbrella with a bag"),
        ({"hat": 1.0}, "A crouching person with a hat"),
        ({}, "A crouching person"),
    ],
)
def test_first_screen_says_what_a_person_wears(worn: dict[str, float], phrase: str) -> None:
    attributes = tuple(
        (name, (worn.get(name, 0.0), 1.0 - worn.get(name, 0.0)))
        for name in ("umbrella", "hat", "bag")
    )
    someone = Variable("blueprint", "categorical", values=("a", "b"), attributes=attributes)
    space = Space((someone, Variable("animation", "categorical", values=("crouching", "walking"))))
    assert person({"blueprint": "a", "animation": "crouching"}, space) == phrase


def test_first_screen_falls_back_to_stills_and_to_words(study: FabricatedStudy) -> None:
    first = without_scripts(make(study, replays=1)).partition("<main>")[0]
    assert (
        "<video" not in first
        and first.count("<img ") == 2
        and "<strong>Before</strong>, base: " in first
    )
    base = read(study.root / "comparison.json", Comparison).versions[0]
    nothing = render(Page("smoke", "headline", (), first=no_fix(base)))
    assert (
        "no other version shown here passes a held-out test that base fails" in nothing
        and "<video" not in nothing
    )
    assert (
        no_fix(base.model_copy(update={"failures": 0})).title
        == "No fix can be shown: base fails no held-out test."
    )


def test_a_film_of_the_first_screen_has_a_line_above_each_view(study: FabricatedStudy) -> None:
    space = study.config.space("F1")
    concrete = space.decode(space.sample(1, np.random.default_rng(0))[0])
    episode = run_test(AnalyticWorld(), VisiblePixelOracle(), CAR, concrete, keep_every=1)
    images = draw_drive(episode)
    assert (
        len(images) == len(episode.frames)
        and images[0].shape[0] == draw_view(episode.frames[0]).shape[0] + STRIP_HEIGHT
    )
    assert not np.array_equal(images[0][:STRIP_HEIGHT], images[-1][:STRIP_HEIGHT]), (
        "time, speed and TTC change"
    )


def test_heat_maps_count_the_pairs_that_tests_and_failures_show(
    study: FabricatedStudy, page: str
) -> None:
    space = study.config.space("F1")
    rows = pd.concat(
        [read_tests(path) for path in study.search_tests if path.parts[-5] == "F1"],
        ignore_index=True,
    )
    rows = rows[rows["status"] == "ok"]
    points, failed = encode_tests(rows, space), rows["failure"].to_numpy()
    shares = pair_shares(space, points, failed)
    categories = space.categorise(points)
    assert len(shares) == len(space) * (len(space) - 1) // 2
    for pair in shares:
        columns = [space.names.index(pair.first), space.names.index(pair.second)]
        assert pair.tests == len({tuple(row) for row in categories[:, columns]})
        assert pair.failures == len({tuple(row) for row in categories[failed][:, columns]})
    assert sum(pair.tests for pair in shares) / sum(
        pair.feasible for pair in shares
    ) == pytest.approx(pair_coverage(space, points))
    shown = next(share for share in shares if (share.first, share.second) == ("rain", "fog"))
    assert f"{shown.tests} = {100 * shown.tests / shown.feasible:.1f} %" in page


def test_the_page_names_seeds_settings_hashes_and_limits(study: FabricatedStudy, page: str) -> None:
    last = page.partition('">Limits, seeds and hashes</h2>')[2].partition("Every test</h2>")[0]
    files = dict(
        re.findall(r"<code>(data/[^<]+)</code></td><td[^>]*>\s*<code>([0-9a-f]{64})</code>", last)
    )
    assert {
        f"data/default/{name}"
        for name in ("measures.json", "comparison.json", "regions/base/F1.json")
    } < set(files)
    assert all(sha256(study.folder / path) == digest for path, digest in files.items())
    for card in map(read_card, study.cards):
        assert card.weights_sha256 in last
    assert ">0, 1</td>" in last and "campaign.failure_threshold_s" in last
    assert all(text in unescape(last) for text in texts.NOT_SHOWN)


def test_theta_is_told_in_numbers(study: FabricatedStudy, page: str) -> None:
    measures = read(study.root / "measures.json", Measures)
    curves = [c.theta for c in measures.campaigns if (c.scenario, c.strategy) == ("F1", "mixed")]
    cells = re.findall(
        r"<td[^>]*>\s*([^<]*)</td>",
        page.partition("Failures found after each quarter")[2].partition("</table>")[0],
    )
    row = cells.index("mixed") + 1
    means = np.mean(curves, axis=0)[[14, 29, 44, 59]]
    assert cells[row : row + 5] == ["60", *(f"{mean:.1f}".removesuffix(".0") for mean in means)]


def test_border_cases_are_nearest_to_the_thresholds_and_half_are_kept() -> None:
    rows = [
        ("a", 25, 40, True),
        ("a", 26, 40, True),
        ("b", 400, 3.1, True),
        ("c", 500, 90, True),
        ("d", 19, 40, False),
        ("e", 400, 1, False),
    ]
    rows.append(("f", 25, 40, True))  # Another frame, although its numbers are those of test a's.
    judged = pd.DataFrame(rows, columns=["test_id", "visible_pixels", "contrast", "kept"])
    judged = judged.assign(
        step=range(7), reason=["visible"] * 4 + ["few_pixels", "low_contrast", "visible"]
    )
    chosen = nearest(judged, 20, 60, 4)
    assert chosen["step"].tolist() == [2, 0, 4, 5]


def test_a_study_whose_versions_learn_from_no_test_has_no_border_cases() -> None:
    config = compose("smoke", ["~arms.random", "~arms.adaptive", "+arms.fresh=new_scenes"])
    assert border_cases(config, {}, []) == ()
    assert not any("border" in path for path in Folders(config).plots)


def test_not_solvable_failures_are_counted(study: FabricatedStudy, page: str) -> None:
    scenarios = [read(path, FailureRegions) for path in study.regions]
    assert all(int(test[-5:]) % 2 == 1 for regions in scenarios for test in regions.not_solvable)
    assert all(
        f"Not solvable with this camera: {len(regions.not_solvable)}." in page
        for regions in scenarios
    )
    assert any(regions.not_solvable for regions in scenarios)


def seeds_of_two(comparison: Comparison) -> Comparison:
    """As if control were a second seed of adaptive."""
    base, control, random, adaptive = comparison.groups
    both = adaptive.model_copy(update={"versions": (*adaptive.versions, *control.versions)})
    pairs = tuple(
        pair for pair in comparison.group_pairs if control.group not in (pair.group, pair.against)
    )
    return comparison.model_copy(update={"groups": (base, random, both), "group_pairs": pairs})


def test_table_of_rounds_lists_each_search() -> None:
    rows = (
        [("base", "random", "ok", True)] * 3
        + [("base", "random", "ok", False)] * 5
        + [("base", "random", "error", False)]
    )
    rows += [("adaptive", "forest", "ok", True), ("adaptive", "forest", "ok", False)]
    part = rounds_part(pd.DataFrame(rows, columns=["version", "strategy", "status", "failure"]), [])
    assert part.table is not None and [row[:3] for row in part.table.rows] == [
        ("base", "random", "3 / 8"),
        ("adaptive", "forest", "1 / 2"),
    ]
    assert part.table.rows[1][3] == "50.0 %"


def test_headline_compares_groups_and_names_significant_differences(study: FabricatedStudy) -> None:
    comparison = read(study.root / "comparison.json", Comparison)
    base, *others = comparison.versions
    text = headline(comparison)
    assert text.startswith(
        f"On the held-out scenario F1*, base fails {base.failures} of {base.tests} tests. Base "
        "failure rate (base"
    )
    better = [
        f"{result.version} {result.failures}" for result in others if result.verdict == "better"
    ]
    assert better and f"Fewer failures than base: {', '.join(better)}." in text
    assert "seeds" not in text

    labels = {"F1star": "F1*", "F2star": "F2*", "F3star": "F3*"}
    two = seeds_of_two(comparison).model_copy(update={"scenarios": labels, "second": None})
    assert "scenarios F1*, F2* and F3*, base fails" in headline(two)
    assert headline(two).endswith(
        "Failures of retrained versions are means over 2 seeds of retraining."
    )
    half = comparison.groups[-1].model_copy(
        update={"failures": Estimate(value=1 / 3, low=0, high=1)}
    )
    assert "adaptive 0.3" in headline(
        comparison.model_copy(update={"groups": (*comparison.groups[:-1], half)})
    )


def test_histogram_counts_each_test_once_however_many_seeds(study: FabricatedStudy) -> None:
    comparison = read(study.root / "comparison.json", Comparison)
    table = read_tests(study.root / "comparison.parquet")
    figure = kpi_histogram(table, seeds_of_two(comparison), 0.1)
    assert [axis.get_title(loc="left") or axis.get_title() for axis in figure.axes] == [
        "base",
        "random",
        "adaptive",
    ]
    heights = []
    for axis in figure.axes:
        heights.append(sum(patch.get_height() for patch in chain(*axis.containers)))
    assert heights == pytest.approx([comparison.versions[0].tests] * 3)


def test_every_kind_of_failure_is_a_point(study: FabricatedStudy) -> None:
    tests = read_tests(study.search_tests[0]).query("status == 'ok'")
    shown = {}
    for mode in MODE_NAMES:
        (axis,) = kpi_scatter(
            tests.assign(failure_mode=mode), [tests["strategy"].iloc[0]], "F1", 0.1
        ).axes
        shown[mode] = {
            str(points.get_label()): len(np.asarray(points.get_offsets()))
            for points in axis.collections
        }
        assert shown[mode][MODE_NAMES[mode]] == len(tests)
    assert MODE_NAMES["false_activation"] not in shown["contact"]


def test_a_dollar_in_a_label_is_a_dollar(tmp_path: Path) -> None:
    with styled():
        figure, axes = panels(1, 1, width=2, height=2)
        axes[0][0].set_title("between $5 and $6_{")
        save_png(figure, tmp_path / "figure.png")
        assert "<!-- between $5 and $6_{ -->" in svg(figure, "two prices")


def test_regressions_shown_are_the_champions(study: FabricatedStudy, page: str) -> None:
    comparison = read(study.root / "comparison.json", Comparison)
    shown = (
        page.partition("Fixes and regressions</h3>")[2]
        .partition("<table>")[2]
        .partition("</table>")[0]
    )
    changed = pd.read_csv(study.root / "changes.csv")
    assert set(changed["version"]) > {comparison.champion}
    assert shown.count("<tr>") - 1 == min(20, (changed["version"] == comparison.champion).sum())
    assert f">{comparison.champion}<" in shown


def test_regressions_come_first(study: FabricatedStudy) -> None:
    comparison = read(study.root / "comparison.json", Comparison)
    rows = (
        pd.read_csv(study.root / "changes.csv")
        .query("version == @comparison.champion")
        .head(3)
        .assign(change=["fix", "regression", "fix"], test_id="F1star-00001")
    )
    parts = verdict_section(comparison, rows, [], None, [], []).parts
    table = next(part.table for part in parts if part.title == "Fixes and regressions")
    assert table is not None and [row[2] for row in table.rows] == ["regression", "fix", "fix"]


def test_sections_without_data_are_left_out(study: FabricatedStudy) -> None:
    measures, regions = (
        read(study.root / "measures.json", Measures),
        tuple(read(path, FailureRegions) for path in study.regions),
    )
    rows = pd.concat([read_tests(path) for path in study.search_tests], ignore_index=True)
    data = ReportData(
        version="base",
        measures=measures,
        regions=regions,
        scenarios={
            of_scenario.scenario: (
                ScenarioInfo(of_scenario.scenario, of_scenario.label, "", 1),
                study.config.space(of_scenario.scenario),
            )
            for of_scenario in regions
        },
        rows=rows,
        learnt=rows,
        detectors={"base": study.cards[0].with_name("model.onnx")},
        frames=(),
        files={},
    )
    figures = draw_figures(data, study.config.strategies, 0.1)
    assert set(figures) == {"theta", "coverage"} | {
        f"{kind}_{name}" for kind in ("kpi", "pairs", "failures") for name in ("F1", "F2")
    }
    held_out = study.config.scenarios["F1star"]
    other = held_out.model_copy(
        update={
            "space": {
                **held_out.space,
                "mud": {"kind": "continuous", "unit": "%", "low": 0, "high": 100, "cuts": [50]},
            }
        }
    )
    update = {
        "report": study.config.report.model_copy(update={"replays": 1}),
        "held_out": ("F1star",),
    }
    config = study.config.model_copy(
        update=update | {"scenarios": {**study.config.scenarios, "F1star": other}}
    )
    page = make_page(
        config, data, figures, lambda *_: None
    )  # No test has the held-out scenario's own variable.
    assert [section.title for section in page.sections] == [
        "Failure regions",
        "Search",
        "Limits, seeds and hashes",
    ]
    titles = [part.title for part in page.sections[1].parts if part.title]
    assert (
        titles == ["Failures found", "Failures by cause", "Coverage of the scenario space"]
        and page.first is None
    )
    assert (page.title, page.headline.count("tests fail")) == ("Where does the detector fail?", 2)


def test_a_detector_that_fails_every_test_is_said_to(study: FabricatedStudy) -> None:
    some = read(study.regions[0], FailureRegions)
    every = some.model_copy(update={"failures": some.tests})
    assert (
        sections.headline([every], [])
        == f"{some.label}: every test fails ({some.tests} of {some.tests})."
    )
    drawing = Drawing("<svg/>", "")
    texts = [
        sections.regions_section([shown], [], {some.scenario: drawing}, {some.scenario: ()})
        .parts[0]
        .text
        for shown in (every, some)
    ]
    assert texts[0].startswith("Every test fails. ") and "Every test" not in texts[1]


def sentences() -> list[str]:
    """Every sentence of the report's prose."""
    prose = list(texts.FIGURES.values())
    for name, text in vars(texts).items():
        if name.isupper() and isinstance(text, str):
            prose.append(text)
    return re.split(r"(?<=[.!?]) ", " ".join(prose))


def test_no_sentence_is_long() -> None:
    assert [sentence for sentence in sentences() if len(sentence.split()) > 30] == []


def test_failures_by_round_are_drawn_from_the_base_on(study: FabricatedStudy) -> None:
    comparison = read(study.root / "comparison.json", Comparison)
    adaptive = comparison.groups[-1]
    second = adaptive.model_copy(
        update={"group": "adaptive-r2", "round": 2, "failures": Estimate(value=1, low=0, high=2)}
    )
    figure = failures_by_round(
        comparison.model_copy(update={"groups": (*comparison.groups, second)})
    )
    bars = [bar for bar in figure.axes[0].containers if isinstance(bar, ErrorbarContainer)]
    drawn = {bar.get_label(): np.asarray(bar.lines[0].get_data(), float) for bar in bars}
    assert drawn["adaptive"].round().tolist()[0] == [0, 1, 2]
    assert drawn["adaptive"][1].tolist() == [
        comparison.groups[0].failures.value,
        adaptive.failures.value,
        1,
    ]
    assert drawn["control"].round().tolist()[0] == [0, 1]
