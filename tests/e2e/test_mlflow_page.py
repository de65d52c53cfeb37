"""MLflow's own page that compares the versions of the detector, in a real headless Chromium."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from urllib.error import URLError

import pytest
from playwright.sync_api import Page, expect

from pipeline.tracking.registry import Registration, Registry
from pipeline.tracking.runs import Content, Tracker
from tests.browser import new_page, open_browser

SHOTS = Path("data/test-artefacts")
FAILURES = {"base": 21, "control": 20, "random": 11, "adaptive": 6}
TABLE = "| version | failures |\n| --- | --- |\n| **adaptive** | **6** |"


def register(root: Path) -> Path:
    """A store with four versions of the detector, and a study whose description compares them."""
    store, model = root / "mlflow.db", root / "model.json"
    tracker = Tracker(store, root / "artifacts", "blindspot/default", {})
    registry = Registry(tracker)
    runs = []
    for version, failures in FAILURES.items():
        model.write_text(version)
        metrics = {"failures": float(failures), "failures.F1star": float(failures), "ap50": 0.88}
        content = Content(
            f"default/{version}", "model", params={"version": version}, metrics=metrics
        )
        tags = {"version": version, "failures": str(failures)}
        number, run = registry.register(Registration("detector", content, [model], tags))
        registry.set_alias("detector", f"default-{version}", number)
        runs.append(run)
    tracker.describe(tracker.log(Content("default", "study")), "The verdict.", runs)
    registry.set_alias("detector", "champion", number)
    registry.describe("detector", TABLE, number)
    return store


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    store = register(tmp_path)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "mlflow", "ui"]
    command += ["--backend-store-uri", f"sqlite:///{store}", "--workers", "1"]
    environment = {**os.environ, "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
    with (tmp_path / "server.log").open("wb") as log:
        server = subprocess.Popen(
            [*command, "--host", "127.0.0.1", "--port", str(port)],
            stdout=log,
            stderr=log,
            env=environment,
            start_new_session=True,
        )
    try:
        wait_for(f"http://127.0.0.1:{port}/health", server, tmp_path / "server.log")
        yield f"http://127.0.0.1:{port}"
    finally:
        # The server starts workers; all are one process group.
        os.killpg(server.pid, signal.SIGTERM)
        server.wait(timeout=30)


def wait_for(url: str, server: subprocess.Popen[bytes], log: Path) -> None:
    for _ in range(240):
        assert server.poll() is None, log.read_text()
        try:
            urllib.request.urlopen(url, timeout=2).close()
        except (URLError, ConnectionError, TimeoutError):
            time.sleep(0.5)
        else:
            return
    pytest.fail(f"the server did not answer:\n{log.read_text()}")


def drive(page: Page, address: str) -> None:
    """Like a person: open the model, tick all versions, press Compare, read the numbers."""
    page.goto(f"{address}/#/models/detector")
    for number in range(1, len(FAILURES) + 1):
        row = page.get_by_role("row").filter(has=page.get_by_role("link", name=f"Version {number}"))
        row.get_by_role("checkbox").check(force=True)
    expect(page.get_by_text("@ champion")).to_be_visible()
    expect(page.get_by_text("@ default-adaptive")).to_be_visible()
    page.screenshot(path=SHOTS / "mlflow-versions.png")
    page.get_by_role("button", name="Compare", exact=True).click()
    expect(page.get_by_text("Comparing 4 Versions")).to_be_visible()
    for version in FAILURES:
        expect(page.get_by_text(f"default/{version}")).to_be_visible()
    row = page.get_by_role("row", name=re.compile(r"^failures\s"))
    expect(row.get_by_role("cell")).to_have_text([str(failures) for failures in FAILURES.values()])


def open_saved(page: Page, address: str) -> None:
    """From the list of runs to the study, and by the link in its description to the comparison."""
    # Without it MLflow shows a new browser the pages for language models.
    page.goto(f"{address}/#/experiments/1?workflowType=machine_learning")
    page.locator("a[href*='/runs/']").get_by_text("default", exact=True).click()
    with page.context.expect_page() as opened:
        page.get_by_role("link", name="Compare the versions").click()
    compared = opened.value
    expect(compared.get_by_text("Comparing 4 Runs from 1 Experiment")).to_be_visible(timeout=60_000)
    for version in FAILURES:
        expect(compared.get_by_text(f"default/{version}").first).to_be_visible()


def read_description(page: Page, address: str) -> None:
    """A version's page shows its description as a table."""
    page.goto(f"{address}/#/models/detector/versions/{len(FAILURES)}")
    described = page.get_by_test_id("note-editor-preview-content")
    expect(described.get_by_role("cell", name="adaptive")).to_be_visible()
    page.screenshot(path=SHOTS / "mlflow-version.png")


def test_versions_compare_in_the_browser(address: str) -> None:
    SHOTS.mkdir(parents=True, exist_ok=True)
    with open_browser() as browser, new_page(browser, 1700, 1300) as page:
        page.set_default_timeout(60_000)
        expect.set_options(timeout=60_000)
        try:
            drive(page, address)
            open_saved(page, address)
            read_description(page, address)
        finally:
            page.screenshot(path=SHOTS / "mlflow-comparison.png")
    assert (SHOTS / "mlflow-comparison.png").stat().st_size > 20_000
