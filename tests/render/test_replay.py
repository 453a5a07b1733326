"""Test that replay arrays, packed and thinned ones, and pages in a browser equal the simulator at every moment."""

from __future__ import annotations

import dataclasses
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.render.conftest import CONFIG, Opener, driven, needs_chromium, until
from warehouse_env.errors import WarehouseError
from warehouse_env.render import pages
from warehouse_env.render.pages import PAGE, SHARED, thinned, write_replay_page
from warehouse_env.render.replay import FLAGS, REWARD_TERMS, Replay, replay_of, simplified
from warehouse_env.render.replay_codec import packed, position_unit
from warehouse_env.simulation.senses import rewards


def shares(observation: np.ndarray) -> np.ndarray:
    """Return shares of 20 actions that depend on the observation."""
    liked = np.abs(np.sin(observation[..., :1] * 50 + np.arange(20)))
    return liked / liked.sum(axis=-1, keepdims=True)


def flag(replay: Replay, name: str) -> np.ndarray:
    return (replay.flags >> FLAGS.index(name) & 1).astype(bool)


def unpacked(replay: Replay) -> dict[str, np.ndarray]:
    """Undo `packed`, as the browser does."""
    about, data = packed(replay)
    found, start, raw = {}, 0, zlib.decompress(data)
    for column in about:
        count, width = int(np.prod(column["shape"])), column["width"]
        planes = np.frombuffer(raw, np.uint8, count * width, start).reshape(width, count).astype(np.uint64)
        values = sum(plane << np.uint64(8 * k) for k, plane in enumerate(planes)).reshape(column["shape"])  # type: ignore[union-attr]
        for _ in range(column["order"]):
            values = np.cumsum(values, axis=-1, dtype=np.uint64)
        whole = (values & np.uint64(256**width - 1)).astype(np.int64)
        if column["signed"]:
            whole = np.where(whole >= 256**width // 2, whole - 256**width, whole)
        found[column["name"]] = whole * column["unit"]
        start += count * width
    assert start == len(raw)
    return found


def test_replay_equals_the_simulator() -> None:
    episode = driven()
    replay = replay_of(episode, "follow", shares, world=1)
    np.testing.assert_array_equal(replay.pose, episode.pose[:, 1])
    assert replay.seed == 4
    assert replay.seconds == pytest.approx(0.2)
    assert REWARD_TERMS == rewards.REWARD_TERMS
    for k, simulator in enumerate(episode.replay()):
        np.testing.assert_array_equal(replay.speed[k], simulator.state.speed[1])
        np.testing.assert_array_equal(replay.rewards[k], simulator.reward_terms[1])
        np.testing.assert_array_equal(replay.waits_for[k], simulator.jams().waits_for[1])
        np.testing.assert_array_equal(flag(replay, "touching")[k], simulator.events.touching[1] > 0)
        np.testing.assert_array_equal(flag(replay, "hit_robot")[k], simulator.events.hit_robot[1] > 0)
        np.testing.assert_array_equal(flag(replay, "hit_person")[k], simulator.events.hit_person[1] > 0)
        persons = simulator.people.persons[1]
        np.testing.assert_array_equal(replay.people[k, :, :2], np.stack([persons["x"], persons["y"]], axis=-1))
        np.testing.assert_allclose(np.cos(replay.people[k, :, 2]), persons["cos"], atol=1e-6)
        assert replay.liked is not None
        np.testing.assert_allclose(replay.liked[k], shares(simulator.observation)[1], atol=1e-6)
        for i, goal in enumerate(simulator.state.goal[1].tolist()):
            assert replay.goal[k, i] == goal[0] * 14 + goal[1]
            assert flag(replay, "loaded")[k, i] == (goal in episode.grid.stations.tolist())
            route = replay.routes[replay.route[k, i]]
            np.testing.assert_array_equal(route[-1], simulator.routes[1, i, simulator.state.route_points[1, i] - 1])
    metrics = simulator.episode_metrics(1)
    assert metrics["collisions_robot"] > 0
    assert metrics["collisions_person"] > 0
    collisions = metrics["collisions_robot"] + metrics["collisions_shelf"] + metrics["collisions_person"]
    assert replay.totals[-1].tolist() == [metrics["goals"], collisions, metrics["near_misses"]]


def test_episode_that_replays_differently_is_refused() -> None:
    episode = driven(20)
    other = dataclasses.replace(episode, actions=np.zeros_like(episode.actions))
    with pytest.raises(WarehouseError, match="cannot be run again to the bit"):
        replay_of(other, "follow")


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 2.0))
def test_simplified_line_stays_within_its_tolerance(seed: int, within: float) -> None:
    line = np.random.default_rng(seed).normal(size=(30, 2)).cumsum(axis=0).astype(np.float32)
    left = simplified(line, within).astype(float)
    begin, step = left[:-1], np.diff(left, axis=0)
    for point in line.astype(float):
        share = ((point - begin) * step).sum(axis=1) / (step**2).sum(axis=1)
        beside = point - begin - share.clip(0, 1)[:, None] * step
        assert np.hypot(*beside.T).min() <= within + 1e-9
    assert {tuple(p) for p in left} <= {tuple(p) for p in line.astype(float)}
    np.testing.assert_array_equal(left[[0, -1]], line[[0, -1]])


def test_thinned_replay_keeps_all_events() -> None:
    whole = replay_of(driven(), "follow", shares, world=1)
    thin = thinned(whole, 7 * 38)  # every fourth of 150 steps, without the last two
    assert thin.every == 4
    assert thin.seconds == pytest.approx(0.8)
    kept = np.arange(0, 149, 4)
    for name in ("pose", "speed", "goal", "along", "route", "totals", "people", "liked", "waits_for"):
        np.testing.assert_array_equal(getattr(thin, name), getattr(whole, name)[kept])
    assert flag(whole, "hit_robot")[1:149].any(axis=1).sum() > 1
    for name in ("arrived", "hit_robot", "hit_shelf", "near_miss", "hit_person"):
        happened = flag(whole, name)[1:149].reshape(37, 4, 7).any(axis=1)
        np.testing.assert_array_equal(flag(thin, name)[1:], happened)
    for name in ("alive", "loaded", "touching", "deadlocked"):
        np.testing.assert_array_equal(flag(thin, name), flag(whole, name)[kept])
    np.testing.assert_allclose(thin.rewards[1:], whole.rewards[1:149].reshape(37, 4, 7, -1).sum(axis=1), rtol=1e-6)
    assert thinned(whole).every == 1
    for line, planned in zip(thin.routes, whole.routes, strict=True):
        np.testing.assert_array_equal(line[[0, -1]], planned[[0, -1]])
        assert len(line) <= len(planned)


def test_packed_replay_round_trips() -> None:
    replay = replay_of(driven(), "follow", shares)
    found = unpacked(replay)
    unit = position_unit(replay.grid)
    assert unit == 0.002
    near: dict[str, Any] = {"rtol": 0, "atol": unit / 2 + 1e-6}
    np.testing.assert_allclose(found["x"].T, replay.pose[..., 0], **near)
    np.testing.assert_allclose(found["y"].T, replay.pose[..., 1], **near)
    np.testing.assert_allclose(found["along"].T, replay.along, **near)
    points = np.concatenate(replay.routes)
    np.testing.assert_allclose(np.stack([found["route_x"], found["route_y"]], axis=1), points, **near)
    turned = (found["heading"].T - replay.pose[..., 2] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(turned).max() < np.pi / 8192 + 1e-6
    for name in ("goal", "route", "waits_for", "yields_to", "held_by", "flags", "totals"):
        np.testing.assert_array_equal(found[name].T, getattr(replay, name))
    for k, term in enumerate(REWARD_TERMS):
        most = np.abs(replay.rewards[..., k]).max()
        np.testing.assert_allclose(found[f"reward {term}"].T, replay.rewards[..., k], rtol=0, atol=most / 250)
    assert replay.liked is not None
    np.testing.assert_allclose(np.moveaxis(found["liked"], -1, 0), replay.liked, rtol=0, atol=0.008)
    cells = found["cells"].reshape(10, 14).astype(int)
    np.testing.assert_array_equal(cells & 1, replay.grid.occupied)
    np.testing.assert_array_equal(np.argwhere(cells & 2), sorted(replay.grid.picks.tolist()))
    np.testing.assert_array_equal(np.argwhere(cells & 4), sorted(replay.grid.stations.tolist()))
    np.testing.assert_allclose(found["height"].reshape(10, 14), replay.grid.height, atol=1e-3)
    np.testing.assert_array_equal(found["one_way"].reshape(10, 14), replay.grid.one_way)


def test_goal_poses_are_packed() -> None:
    replay = replay_of(driven(), "follow")
    assert replay.ends is None
    ends = np.zeros((*replay.pose.shape[:2], 3), np.float32)
    ends[..., 0], ends[..., 1], ends[:, 0, 2], ends[:, 1:, 2] = 3.25, 4.5, -1.0, np.nan
    found = unpacked(dataclasses.replace(replay, ends=ends))
    np.testing.assert_allclose(found["goal_x"], 3.25, atol=0.002)
    np.testing.assert_allclose(found["goal_y"], 4.5, atol=0.002)
    np.testing.assert_allclose(found["goal_heading"][0], 2 * np.pi - 1.0, atol=1e-3)
    assert (found["goal_heading"][1:] < 0).all()


@pytest.fixture(scope="module")
def replay() -> Replay:
    return replay_of(driven(), "follow <b>&", shares)


@pytest.fixture(scope="module")
def one(replay: Replay, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a page of one episode."""
    path = tmp_path_factory.mktemp("page") / "replay.html"
    write_replay_page(path, [replay], "A </script> & more")
    return path


@pytest.fixture(scope="module")
def two(replay: Replay, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a page of that episode beside a shorter one."""
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


def test_every_script_is_part_of_a_page() -> None:
    for folder, names in (
        ("", SHARED), (pages.REPLAY, pages.REPLAY_SCRIPTS), (pages.LIVE, pages.LIVE_SCRIPTS),
    ):  # fmt: skip
        assert {path.stem for path in (PAGE / folder).glob("*.js")} == set(names)


def test_page_fetches_nothing(one: Path) -> None:
    text = one.read_text(encoding="utf-8")
    assert not re.findall(r"(?:src|href)=\"(?!data:)", text)
    assert "default-src 'none'" in text
    assert one.stat().st_size < 300_000


@needs_chromium
def test_page_shows_the_replay_arrays(one: Path, replay: Replay, open_page: Opener) -> None:
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
def test_page_interpolates_thinned_poses(replay: Replay, open_page: Opener, tmp_path: Path) -> None:
    """On a page of every fourth step, interpolated poses are closer to the true ones than chords."""
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
def test_page_lidar_equals_the_observed_lidar(one: Path, open_page: Opener) -> None:
    """The lidar that the page computes from poses equals the observed one."""
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
def test_two_episodes_play_in_step(two: Path, replay: Replay, open_page: Opener) -> None:
    page = open_page(two, "#robot=2")
    other = replay_of(driven(60, True), "front-steered")
    assert page.evaluate("replay.app.robot") == 2
    page.evaluate("replay.seek(33)")
    assert_at(page, replay, 33, 0)
    assert_at(page, other, 33, 1)
    page.evaluate("replay.seek(100)")  # the shorter episode stays at its end
    assert_at(page, replay, 100, 0)
    assert_at(page, other, 60, 1)
    assert page.locator("#totals thead th").all_inner_texts()[1:] == ["follow <b>&", "front-steered"]
