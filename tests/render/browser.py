"""A headless Chromium for the tests of pages: Debian's package, driven by Playwright."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on the PATH (Debian: apt install chromium)")

Opener = Callable[..., Any]
"""Opens a page: a path, what stands behind it in the address, a width and height [px], and options of Playwright's."""


def until(page: Any, expression: str, tries: int = 600) -> None:
    """Wait until an expression is true in a page, half a minute at most; the page itself may not evaluate texts."""
    for _ in range(tries):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"{expression} never came true")
