"""The replay page in a real browser: it loads in silence, plays, scrubs, and shows the arrays."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.render.browser import Opener, needs_chromium, until
from tests.render.episodes import CONFIG, driven
from tests.render.test_replay import shares
from warehouse_env.render import live_page, replay_page
from warehouse_env.render.page_text import PAGE, SHARED
from warehouse_env.render.replay import Replay, replay_of
from warehouse_env.render.replay_page import write_replay_page
from warehouse_env.render.thinning import thinned


@pytest.fixture(scope="module")
def replay() -> Replay:
    return replay_of(driven(), "follow <b>&", shares)


@pytest.fixture(scope="module")
def one(replay: Replay, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of one episode."""
    path = tmp_path_factory.mktemp("page") / "replay.html"
    write_replay_page(path, [replay], "A </script> & more")
    return path


@pytest.fixture(scope="module")
def two(replay: Replay, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of that episode beside a shorter one."""
    path = tmp_path_factory.mktemp("page") / "two.html"
    write_replay_page(path, [replay, replay_of(driven(60, True), "front-steered")], "two")
    return path


def shown(page: Any, panel: int = 0) -> np.ndarray:
    """Return the poses that the page shows, float[N, 3]."""
    return np.array([(r["x"], r["y"], r["heading"]) for r in page.evaluate(f"replay.robots({panel})")])


def assert_at(page: Any, replay: Replay, frame: int, panel: int = 0) -> None:
    walking = np.array([(o["x"], o["y"], o["heading"]) for o in page.evaluate(f"replay.people({panel})")])
    for apart in (shown(page, panel) - replay.pose[frame], walking - replay.people[frame]):
        apart[:, 2] = (apart[:, 2] + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(apart).max() < 0.0012


def test_every_script_is_in_a_page() -> None:
    for folder, names in (
        ("", SHARED), (replay_page.FOLDER, replay_page.SCRIPTS), (live_page.FOLDER, live_page.SCRIPTS),
    ):  # fmt: skip
        assert {path.stem for path in (PAGE / folder).glob("*.js")} == set(names)


def test_nothing_is_fetched(one: Path) -> None:
    text = one.read_text(encoding="utf-8")
    assert not re.findall(r"(?:src|href)=\"(?!data:)", text)
    assert "default-src 'none'" in text
    assert one.stat().st_size < 300_000


@needs_chromium
def test_it_shows_the_arrays(one: Path, replay: Replay, open_page: Opener) -> None:
    page = open_page(one)
    for frame in (0, 1, 77, 150):
        page.evaluate(f"replay.seek({frame})")
        assert page.evaluate("replay.frame()") == frame
        assert_at(page, replay, frame)
        assert page.evaluate("replay.totals()") == replay.totals[frame].tolist()
    page.evaluate("replay.seek(10000)")
    assert page.evaluate("replay.frame()") == 150


@pytest.mark.nightly
@needs_chromium
def test_between_moments_far_apart_robots_are_where_they_were(
    replay: Replay, open_page: Opener, tmp_path: Path
) -> None:
    """A page of every fourth step leads robots through their bends nearer than the chords do."""
    write_replay_page(tmp_path / "thin.html", [thinned(replay, 7 * 38)], "thin")
    page = open_page(tmp_path / "thin.html")
    off, chord_off = [], []
    for k in range(0, 144, 4):
        page.evaluate(f"replay.seek({k / 4 + 0.5})")
        was, chord = replay.pose[k + 2, :, :2], (replay.pose[k, :, :2] + replay.pose[k + 4, :, :2]) / 2
        off.append(np.hypot(*(shown(page)[:, :2] - was).T))
        chord_off.append(np.hypot(*(chord - was).T))
    until(page, "document.querySelector('#length').textContent.endsWith('step 142')")
    assert np.percentile(off, 95) < 0.5 * np.percentile(chord_off, 95)


@pytest.mark.nightly
@needs_chromium
def test_the_lidar_is_the_robots_own(one: Path, open_page: Opener) -> None:
    """What the page works out from the poses is what the robots observed."""
    page = open_page(one)
    rays, most = CONFIG.sensor.rays, CONFIG.sensor.lidar_range
    apart = []
    for k, simulator in enumerate(driven().replay()):
        if k % 30:
            continue
        page.evaluate(f"replay.seek({k})")
        shown(page)
        for i in range(CONFIG.num_agents):
            observed = 1 / simulator.observation[0, i, :rays] - 1
            apart.append(np.abs(np.array(page.evaluate(f"replay.lidar({i})")) - observed.clip(max=most)))
    # a ray along an edge may meet it or miss it by a millimetre
    assert np.mean(np.concatenate(apart) < 0.02) > 0.99


@needs_chromium
def test_two_episodes_are_in_step(two: Path, replay: Replay, open_page: Opener) -> None:
    page = open_page(two, "#robot=2")
    other = replay_of(driven(60, True), "front-steered")
    assert page.evaluate("replay.app.robot") == 2
    page.evaluate("replay.seek(33)")
    assert_at(page, replay, 33, 0)
    assert_at(page, other, 33, 1)
    page.evaluate("replay.seek(100)")  # the shorter one waits at its end
    assert_at(page, replay, 100, 0)
    assert_at(page, other, 60, 1)
    assert page.locator("#totals thead th").all_inner_texts()[1:] == ["follow <b>&", "front-steered"]
