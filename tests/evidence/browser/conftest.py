"""Pages in the system's headless Chromium, driven by Playwright. Needs the package chromium."""

import shutil
from collections.abc import Iterator
from typing import Any

import pytest


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """Start the browser once for the part."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        # Chromium's sandbox fails for root, as in a container; SwiftShader replaces a graphics card.
        options = ["--no-sandbox", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=options)
        yield browser
        browser.close()


@pytest.fixture(autouse=True)
def closed_pages(chromium: Any) -> Iterator[None]:
    """Close a test's pages after it; open pages would use processor time."""
    before = list(chromium.contexts)
    yield
    for context in chromium.contexts:
        if context not in before:
            context.close()


TIMEOUT_MS = 240_000
"""Longest wait for the expected content of a page; a busy machine is slow."""
HINTS = ("GPU stall", "Canvas2D: Multiple readback operations")
"""Browser messages about the speed of software rendering."""


class PageMonitor:
    """Errors and warnings of a page, and the addresses it requests. Create it before the page is opened."""

    def __init__(self, page: Any) -> None:
        self.errors: list[str] = []
        self.requests: list[str] = []
        page.set_default_timeout(TIMEOUT_MS)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", self._record)
        page.on("request", lambda request: self.requests.append(request.url))

    def _record(self, message: Any) -> None:
        if message.type in ("error", "warning") and not any(hint in message.text for hint in HINTS):
            self.errors.append(message.text)
