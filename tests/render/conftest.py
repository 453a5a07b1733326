"""A small floor and a scene on it, for all picture tests; a browser, for those of pages."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from warehouse_env.config import RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.frame import Scene

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


@pytest.fixture
def grid() -> GridMap:
    """10 x 14 cells with one block of shelves in the north-west, at rows 2..3, columns 3..6."""
    occupied = np.zeros((10, 14), dtype=np.bool_)
    occupied[2:4, 3:7] = True
    return GridMap(occupied=occupied, name="small")


@pytest.fixture
def make_scene(grid: GridMap) -> Callable[..., Scene]:
    """Return a maker of scenes with one robot a pose, all alive, untouched and with their goal in the far corner."""

    def make(*poses: tuple[float, float, float], **changes: Any) -> Scene:
        count = len(poses)
        scene = Scene(
            grid=grid,
            bodies=(RobotSpec(),) * count,
            pose=np.array(poses, dtype=np.float32).reshape(-1, 3),
            goal=np.tile(np.array([[9, 13]]), (count, 1)),
            routes=[np.zeros((0, 2), dtype=np.float32)] * count,
            touching=np.zeros(count, dtype=np.bool_),
            alive=np.ones(count, dtype=np.bool_),
            time=12.34,
            text="small",
        )
        return scene._replace(**changes)

    return make


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
        until(page, "window.replay !== undefined")
        opened.append(page)
        return page

    yield opener
    for page in opened:
        page.close()
    assert not faults
