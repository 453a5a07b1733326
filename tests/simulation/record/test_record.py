"""What is kept of an episode: its row of numbers and reward terms by hand, its file to the same bits again."""

from __future__ import annotations

import dataclasses
import io
import math
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.lib import format as npy
from numpy.typing import NDArray

from tests.simulation.worlds import drawn, lay, room, stage
from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.errors import WarehouseError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.record.metrics import episode_row, robot_rows
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import ROBOT, field_of
from warehouse_env.traffic_spec import TrafficSpec

HARD = RewardWeights(
    progress=2.0, arrival=3.0, collision=-7.0, contact=-0.25, proximity=-0.5, time=-0.125, smoothness=-4,
    path_length=-0.375,
)  # fmt: skip


def record(**totals: list[Any]) -> NDArray[Any]:
    count = len(next(iter(totals.values())))
    robots = np.zeros(count, dtype=ROBOT)
    robots["task"]["alive"], robots["totals"]["min_gap"] = 1, 0.5
    for name, values in totals.items():
        field_of(robots, name)[...] = values
    return robots


def test_a_row_by_hand() -> None:
    robots = record(
        distance=[500.0, 700.0, 300.0, 0.0],
        hits_robot=[2, 1, 1, 0],  # pairs 0-1 and 0-2
        hits_shelf=[0, 1, 0, 0],
        near_misses=[3, 3, 0, 0],
        goals=[10, 14, 6, 0],
        planned=[450.0, 600.0, 280.0, 0.0],
        driven_to_goals=[480.0, 690.0, 293.0, 0.0],
        stalled_time=[0.0, 60.0, 60.5, 600.0],
        min_gap=[0.0, 0.0, 0.02, 0.5],
        lived=[6000, 6000, 6000, 2000],
        waited=[0, 500, 1500, 2000],
        late_goals=[6, 0, 0, 0],
        longest_standing=[12.5, 0.0, 0.0, 0.0],
        age=[300, 450, 0, 0],
        longest_age=[400, 0, 0, 0],
        reroutes=[2, 0, 1, 0],
    )
    config = EnvConfig(num_agents=4, max_steps=6000)
    row = episode_row(robots, 600.0, config)
    wanted = {
        "seconds": 600.0, "robot_km": 1.5, "collisions_robot": 2.0, "collisions_shelf": 1.0, "collisions_per_km": 2.0,
        "near_misses": 3.0, "min_clearance_m": 0.0, "goals": 30.0, "goals_per_robot_hour": 30 / 4 * 6,
        "success_rate": 0.75, "path_length_m": 1463 / 30, "path_length_ratio": 1463 / 1330, "stuck": 0.5,
        "waiting_share": 0.2, "late_goals_per_robot_hour": 6 / 4 * 12, "longest_standing_s": 12.5,
        "longest_without_goal_s": 45.0, "reroutes": 3.0,
    }  # fmt: skip
    assert {name: row[name] for name in wanted} == pytest.approx(wanted)
    assert math.isnan(row["makespan_s"])
    assert math.isnan(row["sum_of_costs_s"])
    # a robot's row is that of a world with this robot alone, but for what is shared by pairs
    for k, own in enumerate(robot_rows(robots, np.full(4, 600.0), config)):
        alone = episode_row(robots[k : k + 1], 600.0, config)
        alone |= {name: 2 * alone[name] for name in ("collisions_robot", "near_misses")}
        assert own.pop("distance_m") == robots["totals"]["distance"][k]
        np.testing.assert_equal(own, {name: alone[name] for name in own})


def test_one_shot_times() -> None:
    config = EnvConfig(num_agents=3, tasks="one_shot")
    robots = record(goals=[1, 1, 1], finish_time=[12.0, 40.0, 25.0], alive=[0, 0, 0], stalled_time=[99.0] * 3)
    row = episode_row(robots, 60.0, config)
    assert (row["makespan_s"], row["sum_of_costs_s"], row["success_rate"]) == (40.0, 77.0, 1.0)
    assert row["stuck"] == 0.0  # parked, not stuck
    robots["totals"]["goals"][1], robots["totals"]["finish_time"][1], robots["task"]["alive"][1] = 0, 0.0, 1
    row = episode_row(robots, 60.0, config)
    assert math.isnan(row["makespan_s"])
    assert row["sum_of_costs_s"] == 12 + 60 + 25
    assert row["success_rate"] == pytest.approx(2 / 3)
    assert row["stuck"] == pytest.approx(1 / 3)


def straight(**changes: Any) -> Simulator:
    """One robot at (1.5, 1.5) heading east at up to 1.3 m/s, its goal 12 m on along a one-way aisle."""
    levels = (-0.4, 0.0, 0.5, 1.3)
    grid = drawn(["#" * 15, "." * 15, "#" * 15])
    simulator = stage(grid, (1.5, 1.5, 0.0), action_type="discrete", action_repeat=2, speed_levels=levels, **changes)
    lay(simulator, (1.5, 1.5), (13.5, 1.5))
    simulator.robots[0, 0]["totals"]["task_length"] = 12.0
    return simulator


def test_a_straight_drive_by_hand() -> None:
    # To 1.3 m/s in 1.3 s over 0.845 m, then on; 11.5 m (0.5 m short of the goal) after 1.3 + 10.655 / 1.3 = 9.50 s:
    # in the 0.2 s that end at 9.6 s.
    simulator = straight(tasks="one_shot")
    cruise, paid = np.full((1, 1), simulator.cruise_action), []
    simulator.reward_weights = HARD
    while not simulator.terminated[0, 0] and simulator.steps[0] < 100:
        simulator.step(cruise)
        paid.append(float(simulator.reward_terms[0, 0, 1]))
    assert simulator.steps[0] == 48
    assert paid == [0.0] * 47 + [3.0]
    row = simulator.episode_metrics()
    assert row["makespan_s"] == pytest.approx(9.6)
    assert row["goals"] == 1.0
    driven = row["robot_km"] * 1000
    assert 11.5 <= driven <= 11.5 + 1.3 * 0.1 + 1e-4
    assert row["path_length_m"] == pytest.approx(driven)
    assert row["path_length_ratio"] == pytest.approx(driven / 12.0)
    assert row["goals_per_robot_hour"] == pytest.approx(3600 / 9.6)
    assert row["success_rate"] == 1.0
    assert math.isnan(row["min_clearance_m"])
    simulator.step(cruise)
    assert not simulator.reward_terms.any()  # parked


def test_standing_is_counted_until_the_robot_is_parked() -> None:
    # 6 physics steps under a command to stand; the first that drives ends at 0.1 m/s, where standing ends.
    simulator = straight(tasks="one_shot")
    stop, cruise = np.full((1, 1), 5), np.full((1, 1), simulator.cruise_action)
    for action in (stop, stop, stop, cruise, cruise, cruise, cruise, cruise, cruise, cruise):
        simulator.step(action)
    still = int(simulator.robots["totals"]["waited"][0, 0])
    assert still in (6, 7)  # 0.1 m/s in float32 may fall on either side
    assert simulator.robots["totals"]["lived"][0, 0] == 20
    assert simulator.episode_metrics()["waiting_share"] == still / 20
    while not simulator.terminated[0, 0]:
        simulator.step(cruise)
    lived = int(simulator.robots["totals"]["lived"][0, 0])
    for _ in range(5):
        simulator.step(stop)
    assert (simulator.robots["totals"]["lived"][0, 0], simulator.robots["totals"]["waited"][0, 0]) == (lived, still)


def test_a_robot_without_a_metre_of_progress_is_stuck() -> None:
    simulator = straight(stuck_after=2.05)
    stop = np.full((1, 1), 5)  # level 0 m/s, no offset
    for _ in range(10):
        simulator.step(stop)
    assert simulator.episode_metrics()["stuck"] == 0.0
    simulator.step(stop)
    assert simulator.episode_metrics()["stuck"] == 1.0
    cruise = np.full((1, 1), simulator.cruise_action)
    for _ in range(9):  # 1.8 s: 0.845 + 0.65 m
        simulator.step(cruise)
    assert simulator.episode_metrics()["stuck"] == 0.0
    assert simulator.robots["clocks"]["waiting_time"][0, 0] == 0.0


def test_terms_by_an_independent_sum_over_a_busy_episode() -> None:
    config = EnvConfig(num_agents=8, planner="astar", reward=HARD, max_steps=10**6)
    simulator = Simulator(config, 2, grid=room(8, 8))
    simulator.reset(seed=2)
    rng = np.random.default_rng(0)
    seen = np.zeros(8, dtype=bool)
    for _ in range(150):
        r = simulator.robots
        before = (r["commanded"]["target_speed"].copy(), r["commanded"]["target_steer"].copy())
        distance = simulator.state.distance.copy()
        simulator.step(rng.choice([0, 5, 10, 15, 16, 17], (2, 8), p=[0.05, 0.1, 0.15, 0.5, 0.1, 0.1]))
        e = simulator.events
        expected = np.stack(
            [
                2.0 * e.progress,
                3.0 * e.arrived,
                -7.0 * (e.hit_robot + e.hit_shelf),
                -0.25 * e.touching,
                -0.5 * np.maximum(0.0, 1 - e.gap / 0.3),
                np.full((2, 8), -0.125),
                -4.0
                * (
                    np.abs(r["commanded"]["target_speed"] - before[0]) / 1.5
                    + np.abs(r["commanded"]["target_steer"] - before[1]) / math.radians(60)
                ),
                -0.375 * (simulator.state.distance - distance),
            ],
            axis=-1,
        )
        np.testing.assert_allclose(simulator.reward_terms, expected, atol=1e-5)
        np.testing.assert_allclose(simulator.reward, expected.sum(-1), atol=2e-5)
        seen |= (expected != 0).any((0, 1))
    assert seen.all()


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
