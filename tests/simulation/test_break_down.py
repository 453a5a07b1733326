"""A robot that breaks down: it brakes, and stands for good, whatever it is told and whatever drives around it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from agents import policy_config
from tests.simulation.worlds import raw, room, stage
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import field_of


def test_it_brakes_and_stands() -> None:
    simulator = stage(room(3, 20), (2.0, 1.5, 0.0, 1.5, 0.2))
    simulator.break_down(0, 0)
    for _ in range(15):  # 1.5 m/s at 1 m/s^2
        assert simulator.state.speed[0, 0] > 0
        simulator.step(raw(simulator, (1.0, 1.5)))
    pose = simulator.state.pose.copy()
    assert np.hypot(*(pose[0, 0, :2] - [2.0, 1.5])) == pytest.approx(1.5**2 / 2, abs=0.02)
    for _ in range(20):
        simulator.step(raw(simulator, (1.0, -1.5)))
        np.testing.assert_array_equal(simulator.state.pose, pose)
    assert (simulator.state.speed[0, 0], simulator.state.steer[0, 0]) == (0.0, np.float32(0.2))


def test_the_others_go_on_around_it() -> None:
    base = EnvConfig(num_agents=16, planner="astar_turns", layout="paper46", traffic="routes", action_repeat=2)
    simulator = Simulator(policy_config("greedy", base), 2)
    simulator.reset(7)
    cruise: Any = np.full((2, 16), simulator.cruise_action)
    for _ in range(100):
        simulator.step(cruise)
    simulator.break_down(0, 3)
    for _ in range(10):
        simulator.step(cruise)
    before, goals = simulator.robots.copy(), simulator.robots["totals"]["goals"].sum(axis=1)
    for _ in range(500):
        simulator.step(cruise)
        for name in ("x", "y", "heading", "speed", "steer", "distance", "goals"):
            assert field_of(simulator.robots, name)[0, 3] == field_of(before, name)[0, 3]
    assert (simulator.robots["totals"]["distance"] > before["totals"]["distance"]).sum() > 16  # of both worlds
    assert (simulator.robots["totals"]["goals"].sum(axis=1) >= goals + 5).all()
    assert simulator.terminated.tolist() == [[i == 3 for i in range(16)], [False] * 16]
    assert not simulator.robots["totals"]["hits_robot"].any()
