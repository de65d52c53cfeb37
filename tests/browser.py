"""Pages in the system's headless Chromium; `python -m tests.browser` tells whether one opens."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, Page, sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome")


@contextmanager
def open_browser() -> Iterator[Browser]:
    """The system's Chromium; playwright's is not downloaded."""
    paths = [path for path in map(shutil.which, NAMES) if path]
    assert paths, (
        "no Chromium on this machine; as root, type: "
        "apt-get install -y --no-install-recommends chromium libatomic1"
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


def main() -> int:
    """Exit code 0 if a page opens, 1 if not."""
    try:
        with open_browser() as browser, new_page(browser, 100, 100) as page:
            page.set_content("<p>ready</p>")
    except Exception:  # A missing library ends Playwright's driver in many ways.
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
