"""Test that the server admits only its page and explains refusals, the page in a browser, and Ctrl-C."""

from __future__ import annotations

import http.client
import json
import signal
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.render.conftest import Opener, needs_chromium, opening, until
from tests.render.conftest import browser as browser  # a fixture
from tests.train.live.worlds import world
from train.cli import STOPPED
from train.commands.live import about_live
from train.live import messages
from train.live.drive import WorldRunner
from train.live.messages import Listeners, note
from train.live.server import Server
from train.live.world import Command, Play, live_floors
from warehouse_env.errors import ConfigError
from warehouse_env.render.pages import LivePage, live_page


class CommandRecorder:
    """Runner that records commands without running them."""

    def __init__(self) -> None:
        self.listeners = Listeners()
        self.commands: list[Command] = []

    def look(self) -> None: ...

    def ask(self, command: Command) -> None:
        if isinstance(command, Play) and not command.playing:
            raise ConfigError("it never pauses")
        self.commands.append(command)


@contextmanager
def serving(runner: Any, page: LivePage) -> Iterator[Server]:
    with Server(runner, page) as running:
        thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
        thread.start()
        yield running
        running.shutdown()


@pytest.fixture
def server() -> Iterator[Server]:
    with serving(CommandRecorder(), live_page("title", 0.1, {})) as running:
        yield running


def answer(
    server: Server, method: str = "GET", what: str = "", body: bytes | None = None, **headers: str
) -> tuple[int, Any, http.client.HTTPResponse]:
    """Send a request below the token; headers with _ for -. Return status, JSON or text, and response."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    path = what if what.startswith("/") else f"/{server.token}/{what}"
    connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
    response = connection.getresponse()
    text = response.read().decode()
    connection.close()
    return response.status, json.loads(text) if text.startswith("{") else text, response


def test_page_has_protective_headers(server: Server) -> None:
    assert server.server_address[0] == "127.0.0.1"
    assert len(server.token) >= 32
    status, text, response = answer(server)
    assert (status, text) == (200, server.page.text)
    policy = response.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "connect-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert response.headers["Cache-Control"] == "no-store"
    assert response.headers["Referrer-Policy"] == "no-referrer"
    assert "Access-Control-Allow-Origin" not in response.headers


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "evil.example"}, 421),  # a foreign name that resolves to 127.0.0.1
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Host": "localhost:{port}", "Origin": "http://localhost:{port}"}, 200),
        ({"Origin": "http://127.0.0.1:{port}", "Sec_Fetch_Site": "same-origin"}, 200),
    ],
)
def test_requests_of_other_sites_are_refused(server: Server, headers: dict[str, str], status: int) -> None:
    headers = {name: value.format(port=server.server_port) for name, value in headers.items()}
    for method, what, body in (("GET", "", None), ("POST", "commands", b'{"do": "step"}')):
        got, reply, _ = answer(server, method, what, body, **headers, Content_Type="application/json")
        assert got == status
        assert status == 200 or "\n" not in reply["error"]
    assert len(server.runner.commands) == (status == 200)  # type: ignore[attr-defined]


def test_a_link_on_another_site_opens_only_the_page(server: Server) -> None:
    site = "cross-site"
    assert answer(server, Sec_Fetch_Site=site)[0] == 200
    assert answer(server, "GET", "states", Sec_Fetch_Site=site)[0] == 403
    message = {"Content_Type": "application/json", "Sec_Fetch_Site": site}
    assert answer(server, "POST", "commands", b'{"do": "step"}', **message)[0] == 403
    assert server.runner.commands == []  # type: ignore[attr-defined]


@pytest.mark.parametrize("path", ["/", "/x/commands", "/{token}x/", "/states", "/{token}%C3%A9/"])
def test_requests_without_token_are_refused(server: Server, path: str) -> None:
    path = path.format(token=server.token)
    assert answer(server, "GET", path)[0] == 403
    assert answer(server, "POST", path, b'{"do": "step"}', Content_Type="application/json")[0] == 403


def test_other_addresses_and_methods_do_not_exist(server: Server) -> None:
    assert answer(server, "GET", "other")[0] == 404
    assert answer(server, "GET", "commands")[0] == 404
    assert answer(server, "POST", "states", b"{}", Content_Type="application/json")[0] == 404
    for method in ("PUT", "DELETE", "OPTIONS"):  # no OPTIONS: other sites' pages get no permission to send JSON
        assert answer(server, method)[0] == 501


@pytest.mark.parametrize(
    ("body", "headers", "status", "why"),
    [
        (b'{"do": "step"}', {}, 200, None),
        (b'{"do": "step"}', {"Content_Type": "text/plain"}, 415, "application/json"),  # as an HTML form could send
        (b'{"do": "plai"}', {}, 400, "did you mean play"),
        (b"\x00", {}, 400, "JSON object"),
        (b'{"do": "play", "playing": false}', {}, 409, "it never pauses"),
        (b" " * 65_537, {}, 413, "at most 65,536 bytes"),
        (b"{}", {"Content_Length": "-1"}, 411, "how many bytes"),
    ],
)
def test_commands_are_bounded_and_answered(
    server: Server, body: bytes, headers: dict[str, str], status: int, why: str | None
) -> None:
    got, reply, _ = answer(server, "POST", "commands", body, **{"Content_Type": "application/json", **headers})
    assert got == status
    assert why is None or why in reply["error"]


def test_a_stream_gives_messages_until_the_end(server: Server) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    connection.request("GET", f"/{server.token}/states")
    response = connection.getresponse()
    known = server.runner.listeners
    (listener,) = known.now()
    message = note({"playing": True})
    listener.put(message)  # dropped: no whole world was sent before
    listener.put(message, world=True)
    known.put(message)
    assert response.read(2 * len(message)) == 2 * message
    listener.close()
    assert response.read().strip(b"\0") == b""
    connection.close()


def test_number_of_pages_is_limited(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(messages, "MOST", 0)
    status, reply, _ = answer(server, "GET", "states")
    assert status == 503
    assert "close one of them" in reply["error"]


LIVE = "live --layout open --policy greedy --planner astar_turns --robots 4 --seed 7"


def _take_ctrl_c() -> None:
    """Restore SIGINT in a child process, since a shell's background jobs ignore it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_ctrl_c_ends_live_with_one_sentence() -> None:
    command = [sys.executable, "-m", "train.cli", *LIVE.split()]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, preexec_fn=_take_ctrl_c, **pipes) as running:
        try:
            assert running.stdout is not None
            address = running.stdout.readline().split()[4]
            assert address.startswith("http://127.0.0.1:")
            with urllib.request.urlopen(address, timeout=60) as page:
                assert b"<title>Live warehouse</title>" in page.read()
            with urllib.request.urlopen(f"{address}states", timeout=600) as stream:
                length = bytes(4)
                while length == bytes(4):  # the world is being made
                    length = stream.read(4)
            assert length, "the stream ended before the first state"
            running.send_signal(signal.SIGINT)
            _, errors = running.communicate(timeout=60)
        finally:
            running.kill()  # otherwise Popen waits for it
    assert running.returncode == STOPPED
    assert errors.startswith("warehouse: stopped; the last world ran for ")
    assert errors.count("\n") == 1


@pytest.fixture
def open_live(browser: Any) -> Iterator[Opener]:
    """Yield a function that opens pages of four robots on the open floor and waits for them."""
    runner = WorldRunner(world)
    about = about_live(live_floors("open"), "greedy", 4)
    with serving(runner, live_page("Live warehouse", 0.1, about)) as server:
        runner.start()
        # the browser logs the error status of refused commands; kernels may have to compile
        with opening(browser, server.address, "window.live !== undefined", 6000, "Failed to load resource") as open_at:
            yield lambda: open_at(server.address)
        runner.stop(30.0)
    assert runner.failed is None


@needs_chromium
@pytest.mark.nightly
def test_page_shows_and_steers_a_world(open_live: Opener) -> None:
    page, other = open_live(), open_live()
    assert page.inner_text("figcaption b") == "greedy"
    before = page.evaluate("live.seconds()")
    until(page, f"live.seconds() > {before} + 0.5")
    page.fill("#speed", "8")  # as fast as possible
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
