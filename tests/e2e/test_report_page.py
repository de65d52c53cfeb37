"""The report in a real headless Chromium: its table, its plots, its cards and its films."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import pandas as pd
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect

from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import read
from pipeline.artefacts.tables import read_tests
from tests.analysis.fabricated import FabricatedStudy
from tests.browser import new_page, open_browser

SHOTS = Path("data/test-artefacts")


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> FabricatedStudy:
    fabricated = FabricatedStudy(tmp_path_factory.mktemp("study")).make_analysed()
    # Both films of the first screen, and one of a region.
    section = fabricated.config.report.model_copy(update={"replays": 3})
    fabricated.config = fabricated.config.model_copy(update={"report": section})
    fabricated.run("report")
    return fabricated


@pytest.fixture(scope="module")
def rows(study: FabricatedStudy) -> pd.DataFrame:
    return pd.concat(
        map(read_tests, [*study.search_tests, *study.held_out_tests]), ignore_index=True
    )


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with open_browser() as opened:
        yield opened


@pytest.fixture
def page(browser: Browser, study: FabricatedStudy) -> Iterator[Page]:
    """The report, which must print no error and load nothing."""
    complaints: list[str] = []
    addresses: list[str] = []
    with new_page(browser, 1600, 1000) as opened:
        opened.on("console", lambda message: complaints.append(message.text))
        opened.on("pageerror", lambda error: complaints.append(str(error)))
        opened.on("request", lambda request: addresses.append(request.url))
        opened.goto(f"file://{study.root / 'report.html'}")
        opened.wait_for_selector("#explorer[data-ready]")
        yield opened
    complaints += [address for address in addresses if not address.startswith(("file:", "data:"))]
    assert complaints == []


# The scheme changes colours and the width changes the layout, so two pairs cover both.
@pytest.mark.parametrize(("width", "scheme"), [(400, "light"), (1600, "dark")])
def test_axe_finds_no_barrier(
    browser: Browser, study: FabricatedStudy, width: int, scheme: Literal["light", "dark"]
) -> None:
    with new_page(browser, width, 1000) as opened:
        opened.emulate_media(color_scheme=scheme, reduced_motion="reduce")
        opened.goto(f"file://{study.root / 'report.html'}")
        opened.wait_for_selector("#explorer[data-ready]")
        results = Axe().run(opened, options={"resultTypes": ["violations"]})
        assert results.violations_count == 0, results.generate_report()
        assert opened.evaluate("document.documentElement.scrollWidth") <= width


def type_filter(page: Page, column: str, text: str) -> None:
    page.get_by_label(f"Filter {column}", exact=True).press_sequentially(text)


def counted(rows: pd.DataFrame, chosen: pd.Series | None = None) -> str:
    tests, failures = len(rows), int(rows["failure"].sum())
    if chosen is None:
        return f"{tests} tests, {failures} failures"
    return (
        f"{chosen.sum()} of {tests} tests, {int(rows[chosen]['failure'].sum())} of {failures} "
        "failures"
    )


def some_of(rows: pd.DataFrame, failures: str = r"\d+") -> re.Pattern[str]:
    """The count of any choice of rows."""
    return re.compile(
        rf"^\d+ of {len(rows)} tests, {failures} of {int(rows['failure'].sum())} failures$"
    )


def test_filters_count_as_the_tables_do(page: Page, rows: pd.DataFrame) -> None:
    count = page.locator("#explorer-count")
    expect(count).to_have_text(counted(rows))
    type_filter(page, "fog (%)", ">= 60")
    expect(count).to_have_text(counted(rows, rows["fog"] >= 60))
    type_filter(page, "animation", "walking | limping")
    both = (rows["fog"] >= 60) & rows["animation"].isin(["walking", "limping"])
    expect(count).to_have_text(counted(rows, both))
    page.get_by_role("button", name="Show all tests").click()
    expect(count).to_have_text(counted(rows))


@pytest.mark.parametrize(
    ("text", "chosen"), [("> 62,5 %", 62.5), ("> 62.5", 62.5), ("> 1,000", 1000), ("> 1,0", 1)]
)
def test_a_filter_reads_numbers_as_people_write_them(
    page: Page, rows: pd.DataFrame, text: str, chosen: float
) -> None:
    type_filter(page, "fog (%)", text)
    expect(page.locator("#explorer-count")).to_have_text(counted(rows, rows["fog"] > chosen))


def test_texts_of_a_study_are_no_html(
    browser: Browser, study: FabricatedStudy, tmp_path: Path
) -> None:
    page = (study.root / "report.html").read_text()
    data = re.findall(r'id="explorer-data"[^>]*>([^<]+)<', page)[0]
    content = json.loads(gzip.decompress(base64.b64decode(data)))
    fields = {field["name"]: field for field in content["fields"]}
    person, fog = fields["blueprint"], fields["fog"]
    person["known"], fog["unit"] = [f"<i>{name}</i>" for name in person["known"]], "<i>%</i>"
    named = base64.b64encode(gzip.compress(json.dumps(content).encode())).decode()
    (tmp_path / "report.html").write_text(page.replace(data, named))
    with new_page(browser, 1600, 1000) as opened:
        opened.goto(f"file://{tmp_path / 'report.html'}")
        opened.wait_for_selector("#explorer[data-ready]")
        assert opened.locator("#explorer-table i").count() == 0
        expect(
            opened.locator(".tabulator-col[tabulator-field=fog] .tabulator-col-title")
        ).to_have_text("fog (<i>%</i>)")
        expect(opened.locator(".tabulator-cell[tabulator-field=blueprint]").first).to_have_text(
            re.compile("^<i>.+</i>$")
        )


def test_a_click_on_a_title_sorts(page: Page, rows: pd.DataFrame) -> None:
    page.locator(".tabulator-col[tabulator-field=fog] .tabulator-col-title").click()
    first = page.locator(".tabulator-row .tabulator-cell[tabulator-field=fog]").first
    expect(first).to_have_text(f"{rows['fog'].min():.4g}")


def test_an_area_of_the_plot_chooses_rows(page: Page, rows: pd.DataFrame) -> None:
    page.get_by_role("button", name="Choose an area").click()
    drag(page, "#explorer-scatter", (0.3, 0.3), (0.6, 0.95))
    expect(page.locator("#explorer-count")).to_have_text(some_of(rows))
    page.get_by_role("button", name="Choose an area").click()
    expect(page.locator("#explorer-count")).to_have_text(counted(rows))


def test_a_filter_after_an_area_replaces_it(page: Page, rows: pd.DataFrame) -> None:
    page.get_by_role("button", name="Choose an area").click()
    drag(page, "#explorer-scatter", (0.3, 0.3), (0.6, 0.95))
    expect(page.locator("#explorer-count")).not_to_have_text(counted(rows))
    type_filter(page, "fog (%)", ">= 60")
    expect(page.locator("#explorer-count")).to_have_text(counted(rows, rows["fog"] >= 60))
    page.get_by_role("button", name="Show all tests").click()
    expect(page.locator("#explorer-count")).to_have_text(counted(rows))
    page.get_by_role("button", name="Choose an area").click()
    drag(page, "#explorer-scatter", (0.3, 0.3), (0.6, 0.95))
    page.wait_for_timeout(300)  # What would take the choice back comes right after it.
    expect(page.locator("#explorer-count")).to_have_text(some_of(rows))


def test_a_range_of_an_axis_chooses_rows(page: Page, rows: pd.DataFrame) -> None:
    left = 60 / page.locator("#explorer-parallel").bounding_box()["width"]  # type: ignore[index]
    drag(page, "#explorer-parallel", (left, 0.3), (left, 0.6))
    expect(page.locator("#explorer-count")).to_have_text(some_of(rows, "0"))


def drag(page: Page, plot: str, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Drag the mouse between two places, as shares of the plot's width and height."""
    page.locator(plot).scroll_into_view_if_needed()
    box = page.locator(plot).bounding_box()
    assert box is not None
    (x, y), (to_x, to_y) = [
        (box["x"] + at[0] * box["width"], box["y"] + at[1] * box["height"]) for at in (start, end)
    ]
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(to_x, to_y, steps=8)
    page.mouse.up()


def test_a_card_filters_the_table_to_its_region(
    page: Page, study: FabricatedStudy, rows: pd.DataFrame
) -> None:
    region = read(study.regions[1], FailureRegions).regions[0]
    type_filter(page, "fog (%)", ">= 99")
    expect(page.locator("#explorer-count")).to_have_text(counted(rows, rows["fog"] >= 99))
    card = page.locator(f'[data-region="{region.name}"]')
    card.get_by_role("heading").click()
    expect(page.locator("#explorer-count")).to_have_text(
        counted(rows, rows["test_id"].isin(region.members))
    )
    expect(page.get_by_label("Filter region", exact=True)).to_have_value(f"= {region.name}")
    expect(page.locator("#explorer-count")).to_be_in_viewport()


def test_a_card_works_with_the_keyboard_and_gives_its_command(
    page: Page, study: FabricatedStudy, rows: pd.DataFrame
) -> None:
    region = read(study.regions[0], FailureRegions).regions[0]
    card = page.locator(f'[data-region="{region.name}"]')
    page.evaluate("navigator.clipboard.writeText = async text => { window.copied = text; }")
    card.get_by_role("button", name="Copy").press("Enter")
    assert (
        page.evaluate("window.copied")
        == f"python -m pipeline replay {region.representatives[0].test_id}"
    )
    expect(page.locator("#explorer-count")).to_have_text(counted(rows))  # Copying chooses nothing.
    card.get_by_role("button", name=f"Show all {len(region.members)}").press("Enter")
    expect(page.locator("#explorer-count")).to_have_text(
        counted(rows, rows["test_id"].isin(region.members))
    )


def test_the_films_of_the_first_screen_play_together(page: Page) -> None:
    before, after = page.locator("header video").all()
    for film in (before, after):
        expect(film).to_be_in_viewport()
        expect(film).not_to_have_js_property("currentTime", 0)  # It plays.
    # On a slow machine they may have ended, and a film that has ended pauses nothing.
    for film in (before, after):
        film.evaluate("film => { film.currentTime = 0; }")
    before.evaluate("async film => { await film.play(); film.pause(); }")
    expect(after).to_have_js_property("paused", True)


def test_nothing_runs_over_the_edge(page: Page) -> None:
    SHOTS.mkdir(parents=True, exist_ok=True)
    page.locator("#explorer").screenshot(path=SHOTS / "report-explorer.png")
    for width in (400, 900, 1600):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width, width


def test_a_test_shows_its_command_and_its_film(page: Page) -> None:
    test = str(page.locator(".region video").first.get_attribute("id")).removeprefix("film-")
    type_filter(page, "test", test)
    page.locator(".tabulator-row").filter(has_text=test).focus()
    page.keyboard.press("Enter")
    expect(page.locator("#explorer-command")).to_have_text(f"python -m pipeline replay {test}")
    expect(page.locator("#explorer-view video")).to_be_visible()
