"""Pages in headless Chromium, the one that the system has, driven by Playwright."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """The browser, which ends with the file's tests: it would keep a processor busy beside those of other files. Where it is
    missing, tests are skipped, but for CI, where they fail."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        sync_playwright = None
    if CHROMIUM is None or sync_playwright is None:
        reason = "playwright and Debian's package chromium are needed"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(reason)
    with sync_playwright() as playwright:
        # As root, as in a container, Chromium refuses its sandbox; SwiftShader draws what a graphics card would.
        options = ["--no-sandbox", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=options)
        yield browser
        browser.close()


@pytest.fixture(autouse=True)
def closed_pages(chromium: Any) -> Iterator[None]:
    """Pages that a test opened are closed after it, for the same reason."""
    before = list(chromium.contexts)
    yield
    for context in chromium.contexts:
        if context not in before:
            context.close()


HINTS = ("GPU stall", "Canvas2D: Multiple readback operations")
"""Of the browser, on how its drawing in software could be faster: they come with any surface."""


@dataclass
class Watch:
    """What a page did beside what it shows.

    Attributes:
        errors: of its scripts, and what they wrote to the console as warning or error.
        requests: addresses that it asked for.
    """

    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def follow(self, page: Any) -> Any:
        """Begin before the page is opened. Returns the page."""
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda message: self._heard(message))
        page.on("request", lambda request: self.requests.append(request.url))
        return page

    def _heard(self, message: Any) -> None:
        if message.type in ("error", "warning") and not any(hint in message.text for hint in HINTS):
            self.errors.append(message.text)


@pytest.fixture
def watch() -> Watch:
    return Watch()
