"""The report under `explore` in a real headless Chromium: a click on a test makes its film."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from pipeline.config.composing import CONF, dump
from tests.analysis.fabricated import FabricatedStudy
from tests.browser import new_page, open_browser

SLOW_MS = 120_000
"""A film takes seconds, but this machine may be busy."""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> FabricatedStudy:
    fabricated = FabricatedStudy(tmp_path_factory.mktemp("study")).make_analysed()
    section = fabricated.config.report.model_copy(update={"replays": 0})
    fabricated.config = fabricated.config.model_copy(update={"report": section})
    (fabricated.folder / "params.yaml").write_text(dump(fabricated.config, "test"))
    # This campaign is really executed, so its tests end as recorded; the others are fabricated.
    fabricated.run(
        "campaign", kind="campaigns", scenario="F1", strategy="random", version="base", seed="0"
    )
    fabricated.run("report")
    return fabricated


@pytest.fixture(scope="module")
def address(study: FabricatedStudy) -> Iterator[str]:
    """Where the command serves the study; Ctrl-C ends it."""
    command = [sys.executable, "-m", "pipeline", "explore", "--port", "0"]
    environment = {**os.environ, "PYTHONPATH": str(CONF.parents[1])}
    with subprocess.Popen(
        command,
        cwd=study.folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as server:
        assert server.stdout is not None
        line = server.stdout.readline()
        yield line.split(" is at ")[1].split()[0]
        server.send_signal(signal.SIGINT)
        _, errors = server.communicate(timeout=30)
        assert (server.returncode, errors) == (130, "blindspot explore: stopped\n")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with open_browser() as opened:
        yield opened


@pytest.fixture
def page(browser: Browser, address: str) -> Iterator[Page]:
    """The served report, which must print no error and load nothing from elsewhere."""
    complaints: list[str] = []
    addresses: list[str] = []
    with new_page(browser, 1600, 1000) as opened:
        opened.on("console", lambda message: complaints.append(message.text))
        opened.on("pageerror", lambda error: complaints.append(str(error)))
        opened.on("request", lambda request: addresses.append(request.url))
        opened.goto(address)
        opened.wait_for_selector("#explorer[data-ready]")
        yield opened
    served = (address, f"blob:{address}", "data:")
    assert [*complaints, *(url for url in addresses if not url.startswith(served))] == []


def choose(page: Page, test: str) -> None:
    page.get_by_role("button", name="Show all tests").click()
    page.get_by_label("Filter test", exact=True).press_sequentially(test)
    page.locator(".tabulator-row").filter(has_text=test).locator(".tabulator-cell").first.click()


def films(study: FabricatedStudy) -> list[str]:
    return sorted(path.name.partition(".")[0] for path in Path(study.root, "films").glob("*"))


def test_a_click_makes_a_film_that_plays_and_is_kept(page: Page, study: FabricatedStudy) -> None:
    test = "F1-random-base-0-00004"
    assert page.locator(f"#film-{test}").count() == 0 and films(study) == []
    choose(page, test)
    status = page.locator("#explorer-view [role=status]")
    expect(status).to_have_text("The film of this test is being made; this takes a few seconds.")
    video = page.locator("#explorer-view video")
    expect(video).to_be_visible(timeout=SLOW_MS)
    expect(video).not_to_have_js_property("currentTime", 0, timeout=SLOW_MS)  # It plays.
    expect(status).to_be_empty()
    assert films(study) == [test]


def test_going_on_to_another_test_shows_that_one(page: Page) -> None:
    choose(page, "F1-random-base-0-00005")
    choose(page, "F1-random-base-0-00006")
    video = page.locator("#explorer-view video")
    expect(video).to_be_visible(timeout=SLOW_MS)
    expect(video).to_have_attribute("aria-label", "Film of test F1-random-base-0-00006")


def test_a_test_that_ends_otherwise_says_so(page: Page) -> None:
    choose(page, "F2-random-base-0-00007")
    expect(page.locator("#explorer-view video")).to_be_visible(timeout=SLOW_MS)
    expect(page.locator("#explorer-view [role=status]")).to_contain_text("instead of")
