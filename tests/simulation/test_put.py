"""Robots put somewhere see what robots that have driven there see."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.simulation.worlds import drawn, plain_python
from warehouse_env.config import EnvConfig, FleetPart, RobotSpec, SensorSpec
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import GridMap
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


def test_where_a_robot_is_on_its_route() -> None:
    simulator = Simulator(CONFIG.replace(num_agents=1, keep_right=0.0), 2, grid=drawn(["." * 20] * 5))
    simulator.reset_to([Assignment(np.array([(0.9, 2.5, 0.0)]), np.array([(2, 19)]))] * 2, 0)
    pose = np.array([[(10.5, 3.1, 0.1)], [(7.25, 1.5, -0.2)]])
    assert simulator.put(pose, 1.5).tolist() == [True, True]
    r = simulator.robots[:, 0]
    assert r["on_route"]["position"] == pytest.approx([10.0, 6.75], abs=1e-4)
    assert r["on_route"]["lateral"] == pytest.approx([0.6, -1.0], abs=1e-4)
    assert r["on_route"]["bearing"] == pytest.approx([-0.1, 0.2], abs=1e-4)
    assert (
        r["commanded"]["follow_steer"][0] > 0 > r["commanded"]["follow_steer"][1]
    )  # rear wheels: to the right, then to the left
    ego = simulator.layout.slices["ego"].start
    assert simulator.observation[:, 0, ego] == pytest.approx([1.0, 1.0])
    assert simulator.observation[:, 0, ego + 4] == pytest.approx([0.6, -1.0], abs=1e-4)


def test_what_touches_is_found() -> None:
    simulator = Simulator(CONFIG.replace(num_agents=2), 3, grid=drawn(["....#.", "......"]))
    simulator.reset_to([Assignment(np.array([(0.9, 0.5, 0.0), (3.5, 0.5, 0.0)]), np.array([(0, 0), (0, 1)]))] * 3, 0)
    other = (0.9, 0.5, 0.0)
    pose = np.array([[other, (3.5, 1.5, 0.0)], [other, (1.7, 0.5, 0.0)], [other, (4.2, 1.5, 0.0)]])
    assert simulator.put(pose, 0.0).tolist() == [True, False, False]  # free, in the other, in the shelf


MIXED = CONFIG.replace(num_agents=2, fleet=(FleetPart(1, RobotSpec(min_speed=0.0, max_speed=0.8)),))
THERE = [[(5.5, 5.5, 0.0), (9.5, 5.5, 0.0)]]


@pytest.mark.parametrize(
    ("pose", "speed", "says"),
    [
        (THERE, 1e5, "speed: 100000 m/s of robot 0 .* between -0.5 and 1.5"),
        (THERE, [[1.5, 0.81]], "robot 1 must lie between 0 and 0.8"),
        (THERE, [[0.0, -0.1]], "robot 1 must lie between 0 and 0.8"),
        (THERE, [[-0.51, 0.0]], "robot 0 must lie"),
        (THERE, math.nan, "speed=nan"),
        (THERE, [[0.0, math.inf]], "speed="),
        (THERE, [0.0, 0.0], "speed="),
        (THERE, [[0.0], [1.0, 2.0]], "speed="),
        (THERE[0], 0.0, "pose=.*shape"),
        (3.0, 0.0, "pose=3.0"),
        ([[(5.5, 5.5), (9.5, 5.5)]], 0.0, "pose="),
        ("x", 0.0, "pose='x'"),
        (None, 0.0, "pose=None"),
        ([[(1, 1, 2), (1, 1, math.nan)]], 0.0, "pose="),
        ([[(1, 1, 2), (1, 1, -math.inf)]], 0.0, "pose="),
        ([[(1e30, 1, 0), (1, 1, 0)]], 0.0, "not on the floor of 40 x 40 m"),
        ([[(1, 1, 0), (3, 40.1, 0)]], 0.0, r"pose: \(3, 40.1\) is not on the floor"),
        ([[(1, 1, 0), (-0.1, 1, 0)]], 0.0, "not on the floor"),
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


def test_robots_are_put_at_their_limits() -> None:
    simulator = Simulator(MIXED, grid=make_layout("open"))
    simulator.reset(0)
    simulator.put(THERE, [[-0.5, np.float32(0.8)]])
    assert simulator.state.speed.tolist() == [[-0.5, float(np.float32(0.8))]]


@pytest.mark.parametrize("turns", [1, -1, 2, 150, -150])
def test_a_heading_of_many_turns_is_that_of_the_remainder(turns: int) -> None:
    heading, seen = np.pi / 2, []
    for more in (0, turns):
        simulator = Simulator(CONFIG.replace(num_agents=1, arrival="pose"), 2, grid=make_layout("open"))
        turned = heading + more * 2 * np.pi
        simulator.reset_to([Assignment([(20.5, 20.5, turned)], [(30.5, 20.5, 1.0 + turned)])] * 2, 0)
        seen += [simulator.observation.copy(), simulator.state.pose.copy()]
        simulator.put([[(20.5, 20.5, turned)]] * 2, 0.5)
        seen += [simulator.observation.copy(), simulator.state.pose.copy()]
    for one, other in zip(seen[:4], seen[4:], strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def test_no_heading_is_too_large_to_have_a_remainder() -> None:
    simulator = Simulator(CONFIG.replace(num_agents=1, arrival="pose"), grid=make_layout("open"))
    simulator.reset_to([Assignment([(20.5, 20.5, -1e20)], [(30.5, 20.5, 1e300)])], 0)
    assert simulator.state.pose[0, 0, 2] == pytest.approx(math.remainder(-1e20, math.tau), abs=1e-6)
    assert simulator.robots["task"]["goal_heading"][0, 0] == pytest.approx(math.remainder(1e300, math.tau), abs=1e-6)
    assert np.isfinite(simulator.observation).all()


def drive_beyond_the_rim() -> None:
    """Step a body whose centre is 2 m behind its axle, which stands on each side of the rim."""
    long = RobotSpec(length=6.0, wheelbase=3.0, front_overhang=1.0)
    grid = GridMap(np.zeros((20, 20)), discs=[(10.5, 10.5, 0.4)])
    simulator = Simulator(CONFIG.replace(num_agents=1, robot=long, action_type="raw"), 4, grid=grid)
    simulator.reset(0)
    rim = [[(0.0, 10.0, 0.0)], [(20.0, 10.0, np.pi)], [(10.0, 0.0, np.pi / 2)], [(10.0, 20.0, -np.pi / 2)]]
    assert not simulator.put(rim, 0.0).any()
    simulator.step(np.zeros((4, 1, 2)))


def test_bodies_off_the_floor_read_no_memory_that_is_not_theirs() -> None:
    """In plain Python, where an index out of range is an error: the lidar looked two cells off the floor."""
    assert plain_python("from tests.simulation.test_put import drive_beyond_the_rim; drive_beyond_the_rim()") == []
