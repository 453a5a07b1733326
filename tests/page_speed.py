"""`python -m tests.page_speed`: what the live page costs; the server's processor time, frames and bytes a second.

Each count of robots has a `warehouse live` of its own, at the shipped policy and real time, and a Chromium without a
window that looks at it.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tests.render.browser import CHROMIUM, until

WARM_UP = 3.0  # [s]
# the times between frames [ms], for so many ms
FRAMES = """(most) => new Promise((done) => {
  const times = [], begun = performance.now();
  let before = begun;
  const tick = (now) => {
    times.push(now - before);
    before = now;
    if (now - begun < most) requestAnimationFrame(tick);
    else done(times.slice(1));
  };
  requestAnimationFrame(tick);
})"""


@contextmanager
def served(robots: int) -> Iterator[tuple[int, str]]:
    """Yield the process and the address of a live warehouse."""
    command = [sys.executable, "-m", "train.cli", "live", "--robots", str(robots)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as running:
        assert running.stdout is not None
        yield running.pid, running.stdout.readline().split()[4]
        running.send_signal(signal.SIGTERM)


def processor_seconds(pid: int) -> float:
    """Return the processor time of a process so far [s]."""
    with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
        user, system = file.read().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def measured(browser: Any, pid: int, address: str, seconds: float) -> dict[str, float]:
    """Return what a page of 1280 x 800 pixels costs while it shows a world for so long."""
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.goto(address)
    until(page, "window.live !== undefined", 20_000)  # kernels may have to be compiled
    page.wait_for_timeout(1000 * WARM_UP)
    protocol, received = page.context.new_cdp_session(page), list[int]()
    protocol.on("Network.dataReceived", lambda event: received.append(event["dataLength"]))
    protocol.send("Network.enable")
    begun, processor = page.evaluate("live.seconds()"), processor_seconds(pid)
    times = sorted(page.evaluate(FRAMES, 1000 * seconds))
    simulated = page.evaluate("live.seconds()") - begun
    return {
        "simulated s": simulated,
        "server ms a simulated s": 1000 * (processor_seconds(pid) - processor) / simulated,
        "frames/s": 1000 * len(times) / sum(times),
        "99% of frames within ms": times[int(0.99 * len(times))],
        "kB/s": sum(received) / sum(times),
    }


def main() -> None:
    """Measure and print a line each."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, nargs="+", default=[32, 128])
    parser.add_argument("--seconds", type=float, default=20.0)
    given = parser.parse_args()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for robots in given.robots:
            with served(robots) as (pid, address):
                found = measured(browser, pid, address, given.seconds)
            print(f"{robots} robots: " + ", ".join(f"{name} {value:.1f}" for name, value in found.items()), flush=True)
        browser.close()


if __name__ == "__main__":
    main()
