"""A real browser, for tests of the operator's page."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Page, sync_playwright

CHROMIUM = next((path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None)
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")
_FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-sync",
]


def _is_own(url: str, own: str) -> bool:
    parts = urlsplit(url)
    return parts.netloc == own or parts.scheme in ("data", "blob")


@contextmanager
def browsing(url: str, width: int = 1400, height: int = 900) -> Iterator[Page]:
    """A page that is open as long as the block lasts. Complaints of its scripts and requests to other servers fail the test."""
    complaints: list[str] = []
    own = urlsplit(url).netloc
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=_FLAGS)
        try:
            page = browser.new_page(viewport={"width": width, "height": height})
            page.on("pageerror", lambda error: complaints.append(str(error)))
            page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
            page.on("request", lambda asked: None if _is_own(asked.url, own) else complaints.append(f"asks for {asked.url}"))
            page.goto(url)
            yield page
        finally:
            browser.close()
    assert not complaints


@contextmanager
def visiting(url: str, *flags: str) -> Iterator[Page]:
    """A page with possibly refused requests; ``flags``: for Chromium."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=[*_FLAGS, *flags])
        try:
            page = browser.new_page()
            page.goto(url)
            yield page
        finally:
            browser.close()


def until(page: Page, script: str, within_s: float = 30.0) -> Any:
    """Wait until a script gives a value, and return it. Its policy forbids the page itself to evaluate texts."""
    deadline_s = time.monotonic() + within_s
    while not (found := page.evaluate(script)):
        assert time.monotonic() < deadline_s, f"not within {within_s:g} s: {script}"
        page.wait_for_timeout(20)
    return found
