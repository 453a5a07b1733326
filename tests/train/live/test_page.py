"""The live page in a real browser: it shows a world that goes on, and replaces it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.render.conftest import browser as browser  # a fixture
from tests.render.conftest import needs_chromium, until
from tests.train.live.worlds import world
from train.commands.live import about_live
from train.live.drive import WorldRunner
from train.live.server import Server
from train.live.world import LiveFloors
from warehouse_env.render.pages import live_page

Opener = Callable[..., Any]


@pytest.fixture
def server() -> Iterator[Server]:
    """A server of four robots on the open floor, which is not ready at once."""
    runner = WorldRunner(world)
    about = about_live(LiveFloors("open"), "greedy", 4)
    with Server(runner, live_page("Live warehouse", 0.1, about)) as running:
        thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
        thread.start()
        runner.start()
        yield running
        runner.stop(30.0)
        running.shutdown()
        assert runner.failed is None


@pytest.fixture
def open_live(browser: Any, server: Server) -> Iterator[Opener]:
    """Return an opener of live pages; what they complain of, or ask of anybody else, fails the test."""
    faults: list[str] = []
    opened = []

    def opener(width: int = 1280, height: int = 800, **options: Any) -> Any:
        page = browser.new_page(viewport={"width": width, "height": height}, **options)
        # a refused command is an answer with an error's status, of which the browser tells
        page.on("console", lambda m: faults.extend([m.text] * ("Failed to load resource" not in m.text)))
        page.on("pageerror", lambda error: faults.append(f"error: {error}"))
        page.on("request", lambda request: faults.extend([request.url] * (not request.url.startswith(server.address))))
        page.goto(server.address)
        until(page, "window.live !== undefined", 6000)  # kernels may be compiled first
        opened.append(page)
        return page

    yield opener
    for page in opened:
        page.close()
    assert not [fault for fault in faults if not fault.startswith("data:")]


@needs_chromium
@pytest.mark.nightly
def test_it_shows_and_steers_a_world(open_live: Opener) -> None:
    page, other = open_live(), open_live()
    assert page.inner_text("figcaption b") == "greedy"
    before = page.evaluate("live.seconds()")
    until(page, f"live.seconds() > {before} + 0.5")
    page.fill("#speed", "8")  # as fast as it goes
    until(page, "live.pace().speed === null")
    until(page, "live.goals() > 0")
    until(other, "live.goals() > 0 && live.pace().speed === null")

    page.keyboard.press("Space")
    until(page, "!live.pace().playing")
    page.fill("#robots", "6")
    for one in (page, other):
        until(one, "live.robots() === 6")
    until(page, "document.querySelector('#robots-said').textContent === '6'")
    assert other.input_value("#robots") == "6"
