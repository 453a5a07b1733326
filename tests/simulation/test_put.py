"""Robots put somewhere see what robots that have driven there see."""

from __future__ import annotations

import numpy as np
import pytest

from tests.simulation.worlds import drawn
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment

CONFIG = EnvConfig(planner="astar", num_agents=8, action_repeat=1, sensor=SensorSpec(predictions=True))


def test_who_is_put_somewhere_sees_what_one_that_drove_there_sees() -> None:
    grid = make_layout("open")
    driven, standing = (Simulator(CONFIG, grid=grid) for _ in range(2))
    driven.reset(seed=7)
    standing.reset(seed=7)
    for _ in range(40):
        driven.step(np.tile(driven.cruise_action, (1, 8)))
    assert standing.put(driven.state.pose, driven.state.speed).tolist() == [True]
    ego = driven.layout.slices["ego"].start
    steering = [ego + 1, ego + 2]  # the wheels', which turn on; the follower's, which is that of a step before
    kept = np.setdiff1d(np.arange(driven.layout.size), steering)
    assert np.array_equal(standing.observation[..., kept], driven.observation[..., kept])
    straight = np.abs(driven.state.steer[0]) < 2e-3
    assert straight.sum() >= 5
    np.testing.assert_allclose(standing.observation[0, straight], driven.observation[0, straight], atol=2e-3)
    assert np.abs(driven.robots["lateral"]).min() > 1e-3


def test_where_a_robot_is_on_its_route() -> None:
    simulator = Simulator(CONFIG.replace(num_agents=1, keep_right=0.0), 2, grid=drawn(["." * 20] * 5))
    simulator.reset_to([Assignment(np.array([(0.9, 2.5, 0.0)]), np.array([(2, 19)]))] * 2, 0)
    pose = np.array([[(10.5, 3.1, 0.1)], [(7.25, 1.5, -0.2)]])
    assert simulator.put(pose, 1.5).tolist() == [True, True]
    r = simulator.robots[:, 0]
    assert r["position"] == pytest.approx([10.0, 6.75], abs=1e-4)
    assert r["lateral"] == pytest.approx([0.6, -1.0], abs=1e-4)
    assert r["bearing"] == pytest.approx([-0.1, 0.2], abs=1e-4)
    assert r["follow_steer"][0] > 0 > r["follow_steer"][1]  # rear wheels: to the right, then to the left
    ego = simulator.layout.slices["ego"].start
    assert simulator.observation[:, 0, ego] == pytest.approx([1.0, 1.0])
    assert simulator.observation[:, 0, ego + 4] == pytest.approx([0.6, -1.0], abs=1e-4)


def test_what_touches_is_found() -> None:
    simulator = Simulator(CONFIG.replace(num_agents=2), 3, grid=drawn(["....#.", "......"]))
    simulator.reset_to([Assignment(np.array([(0.9, 0.5, 0.0), (3.5, 0.5, 0.0)]), np.array([(0, 0), (0, 1)]))] * 3, 0)
    other = (0.9, 0.5, 0.0)
    pose = np.array([[other, (3.5, 1.5, 0.0)], [other, (1.7, 0.5, 0.0)], [other, (4.2, 1.5, 0.0)]])
    assert simulator.put(pose, 0.0).tolist() == [True, False, False]  # free, in the other, in the shelf
