"""A page in the system's headless Chromium; `python -m tests.browser` tells whether one opens."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Page, sync_playwright


@contextmanager
def browser_page(width: int, height: int) -> Iterator[Page]:
    """An empty page of that size, in pixels."""
    with sync_playwright() as playwright:
        # Chromium's sandbox does not work for root in a container.
        browser = playwright.chromium.launch(
            executable_path=_chromium(), args=["--no-sandbox", "--disable-gpu"]
        )
        try:
            yield browser.new_page(viewport={"width": width, "height": height})
        finally:
            browser.close()


def _chromium() -> str:
    """The system's Chromium; playwright's is not downloaded."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        path = shutil.which(name)
        if path is not None:
            return path
    raise FileNotFoundError(
        "no Chromium on this machine; as root, type: "
        "apt-get install -y --no-install-recommends chromium libatomic1"
    )


def main() -> int:
    """Exit code 0 if a page opens, 1 if not."""
    try:
        with browser_page(100, 100) as page:
            page.set_content("<p>ready</p>")
    except Exception:  # A missing library ends Playwright's driver in many ways.
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
