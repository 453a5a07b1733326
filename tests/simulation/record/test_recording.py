"""Episode files: the same bits again, from the file alone; a damaged file is one sentence."""

from __future__ import annotations

import dataclasses
import io
import math
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import format as npy

from warehouse_env.config import EnvConfig
from warehouse_env.errors import WarehouseError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.traffic_spec import TrafficSpec


def _recorded(action_type: str, steps: int, grid: GridMap | None = None) -> tuple[Episode, list[bytes]]:
    """An episode of two worlds under random actions, and the bits of all robots after each step."""
    config = EnvConfig(num_agents=3, planner="astar", action_type=action_type)  # type: ignore[arg-type]
    simulator = Simulator(config, 2, grid=grid)
    recorder = Recorder(simulator, (3, 8))
    rng = np.random.default_rng(1)
    bits = [simulator.robots.tobytes()]
    for _ in range(steps):
        actions = rng.integers(0, 20, (2, 3)) if action_type == "discrete" else rng.uniform(-1, 1, (2, 3, 2))
        recorder.step(actions)
        bits.append(simulator.robots.tobytes())
    return recorder.episode, bits


@pytest.mark.parametrize("action_type", ["discrete", "continuous", "raw"])
def test_a_loaded_episode_replays_to_the_bit(action_type: str, tmp_path: Path) -> None:
    episode, bits = _recorded(action_type, 100)
    episode.save(tmp_path / "episode.npz")
    loaded = Episode.load(tmp_path / "episode.npz")
    assert loaded.config == episode.config
    assert loaded.seeds == (3, 8)
    replayed = [(sim.robots.tobytes(), sim.state.pose.copy()) for sim in loaded.replay()]
    assert [b for b, _ in replayed] == bits
    np.testing.assert_array_equal(np.array([pose for _, pose in replayed]), episode.pose)


@pytest.mark.parametrize("right_of_way", [False, True])
def test_preferences_are_kept_in_short_and_replay_to_the_bit(right_of_way: bool, tmp_path: Path) -> None:
    config = EnvConfig(num_agents=24, planner="astar", traffic=TrafficSpec(shield=True, right_of_way=right_of_way))
    simulator = Simulator(config, 2)
    recorder = Recorder(simulator, (3, 8))
    rng, bits = np.random.default_rng(5), []
    for _ in range(150):
        liked = rng.normal(size=(2, 24, 20)).round(1)  # with equals
        recorder.step(np.where(rng.random(liked.shape) < 0.1, -np.inf, liked))
        bits.append(simulator.robots.tobytes())
    recorder.episode.save(tmp_path / "episode.npz")
    loaded = Episode.load(tmp_path / "episode.npz")
    assert loaded.actions.dtype == np.uint16
    assert [sim.robots.tobytes() for sim in loaded.replay()][1:] == bits


def test_recorded_headings_are_within_a_turn_and_poses_finite(tmp_path: Path) -> None:
    episode, _ = _recorded("discrete", 3)
    turned = dataclasses.replace(episode, pose=episode.pose + np.array([0.0, 0.0, 6 * math.tau]))
    turned.save(tmp_path / "turned.npz")
    loaded = Episode.load(tmp_path / "turned.npz").pose
    assert np.abs(loaded[..., 2]).max() <= math.pi
    np.testing.assert_allclose(np.cos(loaded), np.cos(episode.pose), atol=1e-5)
    dataclasses.replace(episode, pose=np.full_like(episode.pose, np.nan)).save(tmp_path / "nan.npz")
    with pytest.raises(WarehouseError, match="no complete episode file: pose="):
        Episode.load(tmp_path / "nan.npz")


def test_a_pickle_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "pickle.npz", about=np.array([{"format": 1}], dtype=object))
    with pytest.raises(WarehouseError, match="no complete episode file"):
        Episode.load(tmp_path / "pickle.npz")


def _claiming(kind: str, shape: tuple[int, ...]) -> bytes:
    """Return the header of an array, and nothing behind it."""
    npy.write_array_header_1_0(file := io.BytesIO(), {"descr": kind, "fortran_order": False, "shape": shape})
    return file.getvalue()


@pytest.mark.parametrize("name", ["about", "occupied", "pose", "all"])
def test_what_claims_too_much_is_refused_before_it_is_inflated(name: str, tmp_path: Path) -> None:
    """Gigabytes of zeros would be megabytes in the file; here it ends where they begin."""
    _recorded("discrete", 20)[0].save(tmp_path / "good.npz")
    robots = _recorded("discrete", 20)[0].config.num_agents
    steps = 2**28 // robots + 1
    fitting = {"pose": ("<f4", (steps + 1, 1, robots, 3)), "actions": ("|u1", (steps, 1, robots))}  # to each other
    fitting = fitting if name == "all" else {name: ("|u1", (3_000_000, 1_000))}
    claimed = {f"{one}.npy": _claiming(*what) for one, what in fitting.items()}
    with zipfile.ZipFile(tmp_path / "good.npz") as good, zipfile.ZipFile(tmp_path / "bad.npz", "w") as bad:
        for member in good.namelist():
            bad.writestr(member, claimed.get(member) or good.read(member))
    tracemalloc.start()
    try:
        with pytest.raises(WarehouseError, match=r"no complete episode file: .*(shape|array)"):
            Episode.load(tmp_path / "bad.npz")
        assert tracemalloc.get_traced_memory()[1] < 8_000_000
    finally:
        tracemalloc.stop()
