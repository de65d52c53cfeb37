"""Pages in the system's headless Chromium."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, Page, sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome")


@contextmanager
def open_browser() -> Iterator[Browser]:
    """The system's Chromium; playwright's is not downloaded."""
    paths = [path for path in map(shutil.which, NAMES) if path]
    assert paths, (
        "no Chromium on this machine; as root: apt-get install -y --no-install-recommends chromium"
    )
    with sync_playwright() as playwright:
        # Chromium's sandbox does not work for root in a container.
        browser = playwright.chromium.launch(
            executable_path=paths[0], args=["--no-sandbox", "--disable-gpu"]
        )
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def new_page(browser: Browser, width: int, height: int) -> Iterator[Page]:
    """An empty page without cookies or storage. width, height: in pixels."""
    page = browser.new_page(viewport={"width": width, "height": height})
    try:
        yield page
    finally:
        page.close()
