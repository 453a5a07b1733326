"""A headless Chromium for the tests of pages: Debian's package, driven by Playwright."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on the PATH (Debian: apt install chromium)")

Opener = Callable[..., Any]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A running browser."""
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield running
        running.close()


@pytest.fixture
def open_page(browser: Any) -> Iterator[Opener]:
    """Return an opener of replay pages; whatever they complain of, or ask the network for, fails the test."""
    faults: list[str] = []
    opened = []

    def opener(path: Path, address: str = "", width: int = 1200, height: int = 800, **options: Any) -> Any:
        page = browser.new_page(viewport={"width": width, "height": height}, **options)
        page.on("console", lambda message: faults.append(f"console {message.type}: {message.text}"))
        page.on("pageerror", lambda error: faults.append(f"error: {error}"))
        page.on(
            "request", lambda request: faults.extend([request.url] * (not request.url.startswith(("file:", "data:"))))
        )
        page.goto(f"{path.as_uri()}{address}")
        page.wait_for_function("window.replay")
        opened.append(page)
        return page

    yield opener
    for page in opened:
        page.close()
    assert not faults
