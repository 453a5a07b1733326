"""Robots put somewhere see what robots that have driven there see."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from warehouse_env.config import EnvConfig, FleetPart, RobotSpec, SensorSpec
from warehouse_env.errors import ConfigError
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
    assert np.abs(driven.robots["on_route"]["lateral"]).min() > 1e-3


# of a feature set that test_fleet compiles as well
FLEET = (FleetPart(1, RobotSpec(min_speed=0.0, max_speed=0.8)),)
MIXED = CONFIG.replace(num_agents=2, action_type="raw", sensor=SensorSpec(), fleet=FLEET)
THERE = [[(5.5, 5.5, 0.0), (9.5, 5.5, 0.0)]]


@pytest.mark.parametrize(
    ("pose", "speed", "says"),
    [
        (THERE, 1e5, "speed: 100000 m/s of robot 0 .* between -0.5 and 1.5"),
        (THERE, [[1.5, 0.81]], "robot 1 must lie between 0 and 0.8"),
        (THERE, math.nan, "speed=nan"),
        (THERE, [[0.0], [1.0, 2.0]], "speed="),
        (THERE[0], 0.0, "pose=.*shape"),
        (3.0, 0.0, "pose=3.0"),
        ([[(1, 1, 2), (1, 1, math.nan)]], 0.0, "pose="),
        ([[(1e30, 1, 0), (1, 1, 0)]], 0.0, "not on the floor of 40 x 40 m"),
        ([[(1, 1, 0), (3, 40.1, 0)]], 0.0, r"pose: \(3, 40.1\) is not on the floor"),
    ],
)
def test_what_robots_cannot_be_put_to_is_refused(pose: Any, speed: Any, says: str) -> None:
    """At 1e4 m/s a robot left the floor, at 1e5 m/s the lidar read memory that is not its own."""
    simulator = Simulator(MIXED, grid=make_layout("open"))
    simulator.reset(0)
    before = simulator.robots.tobytes()
    with pytest.raises(ConfigError, match=says):
        simulator.put(pose, speed)
    assert simulator.robots.tobytes() == before


@pytest.mark.parametrize("turns", [-1, 150])
def test_a_heading_of_many_turns_is_that_of_the_remainder(turns: int) -> None:
    heading, seen = np.pi / 2, []
    config = CONFIG.replace(num_agents=1, arrival="pose", sensor=SensorSpec())
    for more in (0, turns):
        simulator = Simulator(config, 2, grid=make_layout("open"))
        turned = heading + more * 2 * np.pi
        simulator.reset_to([Assignment([(20.5, 20.5, turned)], [(30.5, 20.5, 1.0 + turned)])] * 2, 0)
        seen += [simulator.observation.copy(), simulator.state.pose.copy()]
        simulator.put([[(20.5, 20.5, turned)]] * 2, 0.5)
        seen += [simulator.observation.copy(), simulator.state.pose.copy()]
    for one, other in zip(seen[:4], seen[4:], strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)
