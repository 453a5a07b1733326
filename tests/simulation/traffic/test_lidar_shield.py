"""The protective field by lidar alone: what a robot sees is all that it goes by, and nobody touches anything."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from agents import make_policy, policy_config
from tests.simulation.physics.test_no_overlap import MAZE, assert_apart, crowd
from tests.simulation.reference import shelves
from tests.simulation.worlds import drawn, raw, room, stage
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.traffic.audit import SWITCH
from warehouse_env.simulation.traffic.lidar_shield import NOT_SEEN
from warehouse_env.traffic_spec import TRAFFIC, TrafficSpec, UncertaintySpec

FULL = (1.0, 0.0)  # raw: accelerate, steering held
# Two aisles of one cell that meet at a blind corner, and a way on for both.
CORNER = ["#####.##", "#####.##", "#####.##", "........", "#####.##", "#####.##", "#####.##"]


@pytest.fixture(autouse=True)
def _checked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every Simulator of these tests looks for itself whether a safe stop exists, after each physics step."""
    monkeypatch.setenv(SWITCH, "1")


def by_lidar(grid: Any, *poses: Any, **changes: Any) -> Simulator:
    return stage(grid, *poses, **{"traffic": TrafficSpec(shield="lidar"), **changes})


def untouched(simulator: Simulator) -> bool:
    return not (simulator.robots["totals"]["hits_robot"].any() or simulator.robots["totals"]["hits_shelf"].any())


@settings(max_examples=8)
@given(st.integers(0, 10**6), st.sampled_from([1, 6, 25]))
def test_random_commands_in_a_crowded_maze_touch_nothing(seed: int, hold: int) -> None:
    rng = np.random.default_rng(seed)
    grid = drawn(MAZE)
    simulator = by_lidar(grid, *crowd(rng, grid, 9, 0.05))
    walls = shelves(grid.occupied)
    commands = rng.choice([-1.0, 0.0, 1.0], (1, simulator.num_agents, 2), p=[0.25, 0.15, 0.6])
    for _ in range(80):
        fresh = rng.choice([-1.0, 0.0, 1.0], commands.shape, p=[0.25, 0.15, 0.6])
        commands = np.where(rng.random((1, simulator.num_agents, 1)) < 1 / hold, fresh, commands)
        simulator.step(commands)
        assert_apart(simulator, walls)
    assert untouched(simulator)


def test_the_crowds_do_drive() -> None:
    # The property above would be empty if all stood.
    rng = np.random.default_rng(5)
    grid = drawn(MAZE)
    simulator = by_lidar(grid, *crowd(rng, grid, 9, 0.05))
    for _ in range(200):
        simulator.step(rng.choice([-1.0, 0.0, 1.0], (1, simulator.num_agents, 2), p=[0.25, 0.15, 0.6]))
    assert (simulator.robots["totals"]["distance"] > 0.2).mean() > 0.5


def test_in_the_open_nothing_holds_a_robot() -> None:
    simulator = by_lidar(room(20, 30), (4.0, 10.0, 0.0))
    for _ in range(60):
        simulator.step(raw(simulator, FULL))
    assert simulator.state.speed[0, 0] == 1.5
    assert simulator.robots["shield"]["vetoed_time"][0, 0] == 0.0


def test_two_head_on_stop_before_they_meet() -> None:
    simulator = by_lidar(room(5, 30), (2.0, 2.5, 0.0), (28.0, 2.5, math.pi))
    fastest = 0.0
    for _ in range(300):
        simulator.step(raw(simulator, FULL, FULL))
        fastest = max(fastest, float(simulator.state.speed.min()))
    assert untouched(simulator)
    assert fastest > 1.2
    gap = float(simulator.state.pose[0, 1, 0] - simulator.state.pose[0, 0, 0]) - 2 * 0.15
    assert 0.0 < gap < 0.2


def test_a_blind_corner_is_passed_slowly_and_by_both() -> None:
    simulator = by_lidar(drawn(CORNER), (2.0, 3.5, 0.0), (5.5, 1.5, math.pi / 2))
    speeds = []
    for _ in range(400):
        simulator.step(raw(simulator, FULL, FULL))
        speeds.append(simulator.state.speed[0].copy())
    assert untouched(simulator)
    assert (simulator.robots["totals"]["distance"][0] > 0.5).all()
    assert simulator.robots["totals"]["distance"][0].max() > 2.5


def test_what_is_not_heard_does_not_matter() -> None:
    start = [(2.0, 1.5, 0.0), (9.0, 1.6, math.pi), (5.0, 3.4, -0.5)]
    poses: list[NDArray[np.float32]] = []
    for loss, latency in ((0.0, 0.0), (0.9, 0.4)):
        simulator = by_lidar(room(5, 12), *start, uncertainty=UncertaintySpec(loss=loss, latency=latency))
        for _ in range(100):
            simulator.step(raw(simulator, FULL, FULL, (1.0, 0.3)))
        poses.append(simulator.state.pose.copy())
    np.testing.assert_array_equal(poses[0], poses[1])


@pytest.mark.nightly
def test_it_is_the_same_in_any_world(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(SWITCH)
    config = policy_config("greedy", EnvConfig(layout="narrow", num_agents=4, planner="astar_turns"))
    config = config.replace(traffic=replace(TRAFFIC["rules"], shield="lidar"))
    one, three = Simulator(config), Simulator(config, 3)
    policy, rng = make_policy("greedy", config), np.random.default_rng(0)
    single, several = one.reset(7), three.reset([5, 7, 6])
    for _ in range(60):
        single, several = one.step(policy.act(single, rng)), three.step(policy.act(several, rng))
    np.testing.assert_array_equal(one.robots[0], three.robots[1])
    assert one.robots["totals"]["distance"].sum() > 1.0


def test_a_reset_forgets_who_was_seen() -> None:
    simulator = by_lidar(room(5, 12), (2.0, 2.5, 0.0), (7.0, 2.5, math.pi))
    simulator.step(raw(simulator, FULL, FULL))
    assert simulator._sights is not None
    assert simulator._sights[0, 0, 1] != NOT_SEEN
    simulator.reset(0)
    assert (simulator._sights == NOT_SEEN).all()


def test_errors_are_refused() -> None:
    with pytest.raises(ConfigError, match="must be without the shield by lidar where a pose_error"):
        EnvConfig(traffic=TrafficSpec(shield="lidar"), uncertainty=UncertaintySpec(pose_error=0.01))
    with pytest.raises(ConfigError, match=r"TrafficSpec\.shield"):
        TrafficSpec(shield="radar")  # type: ignore[arg-type]
    config = EnvConfig(traffic=TrafficSpec(shield="lidar"))
    assert EnvConfig.from_dict(config.to_dict()) == config
