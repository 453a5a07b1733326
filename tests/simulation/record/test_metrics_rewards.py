"""The episode's row of numbers and the reward terms, by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.simulation.worlds import drawn, lay, room, stage
from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.simulation.record.metrics import episode_row, robot_rows
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import ROBOT, field_of

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
