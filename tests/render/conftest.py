"""Provide a small floor, a scene and short episodes for picture tests, and a browser for page tests."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.frame import Scene
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.simulator import Simulator

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on the PATH (Debian: apt install chromium)")

Opener = Callable[..., Any]
"""Opens a page by its address, or by a path and the rest of the address."""


def until(page: Any, expression: str, tries: int = 600) -> None:
    """Poll an expression in a page until it is true, half a minute at most; the page's policy forbids eval."""
    for _ in range(tries):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"{expression} never came true")


@pytest.fixture
def grid() -> GridMap:
    """Return 10 x 14 cells with one block of shelves in the north-west, at rows 2..3, columns 3..6."""
    occupied = np.zeros((10, 14), dtype=np.bool_)
    occupied[2:4, 3:7] = True
    return GridMap(occupied=occupied, name="small")


@pytest.fixture
def make_scene(grid: GridMap) -> Callable[..., Scene]:
    """Return a factory of scenes with one robot per pose, all alive, without contact, goals in the far corner."""

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
    """Yield a running browser."""
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield running
        running.close()


@contextmanager
def opening(browser: Any, own: str, ready: str, tries: int = 600, expected: str | None = None) -> Iterator[Opener]:
    """Yield a function that opens a page and waits until it is ready.

    Console messages without `expected`, page errors, and requests to other addresses than `own` fail the test.
    """
    faults: list[str] = []
    opened = []

    def complain(message: Any) -> None:
        if expected is None or expected not in message.text:
            faults.append(f"console {message.type}: {message.text}")

    def opener(address: str) -> Any:
        page = browser.new_page(viewport={"width": 1200, "height": 800})
        page.on("console", complain)
        page.on("pageerror", lambda error: faults.append(f"error: {error}"))
        page.on("request", lambda request: faults.extend([request.url] * (not request.url.startswith((own, "data:")))))
        page.goto(address)
        until(page, ready, tries)
        opened.append(page)
        return page

    yield opener
    for page in opened:
        page.close()
    assert not faults


@pytest.fixture
def open_page(browser: Any) -> Iterator[Opener]:
    """Yield a function that opens replay pages, which may send no network request."""
    with opening(browser, "file:", "window.replay !== undefined") as open_at:
        yield lambda path, behind="": open_at(f"{path.as_uri()}{behind}")


# episodes in a tight hall, where robots meet, wait and touch
CONFIG = EnvConfig(num_agents=7, planner="astar", action_repeat=2, people=4)


def hall() -> GridMap:
    """Return 10 x 14 cells with two blocks of shelves, one-way aisles between them, and a ramp."""
    occupied = np.zeros((10, 14), dtype=np.bool_)
    occupied[3:7, 2:6] = occupied[3:7, 8:12] = True
    height = np.zeros((10, 14), dtype=np.float32)
    height[8:, 4:10] = 0.2
    one_way = np.zeros((10, 14), dtype=np.uint8)
    one_way[3:7, 6] = 2
    one_way[3:7, 7] = 4
    return GridMap(occupied, height, name="hall", one_way=one_way)


@lru_cache(maxsize=4)
def driven(steps: int = 150, front_steered: bool = False) -> Episode:
    """Record two worlds of 7 robots that cruise along their routes and ignore each other."""
    robot = RobotSpec(front_overhang=0.75) if front_steered else RobotSpec()
    simulator = Simulator(CONFIG.replace(robot=robot), 2, grid=hall())
    recorder = Recorder(simulator, (9, 4), "follow")
    for _ in range(steps):
        recorder.step(np.full((2, CONFIG.num_agents), simulator.cruise_action))
    return recorder.episode
