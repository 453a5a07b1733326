"""Speed limits of the floor: by hand, whatever a robot is told, and whole steps of all kinds of actions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.physics.zones import most_speed, zones_of
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import ROBOT, parameters_of
from warehouse_env.simulation.tasks.assignment import Assignment

CONFIG = EnvConfig()


def strip(limit: float) -> GridMap:
    """A strip of 20 cells, of which the two in the middle have a limit."""
    speed = np.full((1, 20), np.inf)
    speed[0, 10:12] = limit
    return GridMap(np.zeros((1, 20)), speed=speed)


@kernel
def _most(r, zones, p):
    return most_speed(r[0], zones, p[0])


def robot_at(x: float, speed: float = 0.0) -> Any:
    r = np.zeros(1, ROBOT)
    r["motion"]["x"], r["motion"]["y"], r["motion"]["speed"] = x, 0.5, speed
    return r


def test_the_speed_before_in_and_behind_a_zone_by_hand() -> None:
    """At rest 1 m before, in and 0.5 m behind a zone of 0.5 m/s, with braking planned at 0.9 m/s^2."""
    zones, p = zones_of(strip(0.5), CONFIG), parameters_of(CONFIG, 1.0)
    assert zones is not None
    assert zones.squares.shape == (9, 161)
    found = [_most(robot_at(x), zones, p) for x in (9.0, 10.0, 11.3, 12.5)]
    wanted = [math.sqrt(0.25 + 1.8), 0.5, 0.5, math.sqrt(0.25 + 0.9)]
    assert found == pytest.approx(wanted, rel=1e-6)
    assert _most(robot_at(2.0), zones, p) > 1.5
    assert _most(robot_at(9.95, speed=1.0), zones, p) == 0.5  # it will be in the zone


def test_no_limit_that_binds_is_no_zone() -> None:
    assert zones_of(strip(1.5), CONFIG) is None
    assert zones_of(GridMap(np.zeros((1, 20))), CONFIG) is None
    assert strip(np.inf).speed is None


@given(st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_squares_are_the_least_over_all_zones(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speed = rng.choice([0.3, 0.6, 1.2, np.inf], (5, 6), p=[0.4, 0.2, 0.2, 0.2]).round(1)
    speed[0, 0] = 0.6
    zones = zones_of(GridMap(np.zeros((5, 6)), speed=speed), CONFIG)
    assert zones is not None
    y, x = np.indices(zones.squares.shape) * float(zones.step)
    least = np.full(zones.squares.shape, (1.1 * CONFIG.robot.max_speed) ** 2)
    for row, column in np.argwhere(speed < CONFIG.robot.max_speed).tolist():
        low = 4 - row  # y is up, rows go down
        off = np.hypot(np.clip(x, column, column + 1) - x, np.clip(y, low, low + 1) - y)
        least = np.minimum(least, speed[row, column] ** 2 + 1.8 * CONFIG.robot.max_acceleration * off)
    np.testing.assert_allclose(zones.squares, least, rtol=1e-6)


def driver(grid: GridMap, robots: int) -> Simulator:
    return Simulator(EnvConfig(num_agents=robots, planner="astar", action_type="continuous"), grid=grid)


def test_a_robot_brakes_in_time_and_speeds_up_behind() -> None:
    simulator, way = driver(strip(0.5), 1), []
    simulator.reset_to([Assignment(np.array([(1.0, 0.5, 0.0)]), np.array([(0, 19)]))], 0)
    for _ in range(180):
        simulator.step(np.zeros((1, 1, 2)))
        way.append((simulator.state.pose[0, 0, 0], simulator.state.speed[0, 0]))
    x, speed = np.array(way).T
    assert speed[(x >= 10) & (x <= 12)] == pytest.approx(0.5, abs=1e-3)
    assert speed[(x > 8) & (x < 8.8)].min() > 1.49  # 1.11 m before the zone it has to brake, and not sooner
    assert speed[(x > 13.6) & (x < 18)].min() > 1.49


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_nobody_is_faster_than_its_zone(seed: int) -> None:
    """At the end of a step no faster than its place allows, and one step's braking."""
    rng = np.random.default_rng(seed)
    speed = rng.choice([np.inf, 0.2, 0.5, 0.9, 1.2], (7, 12), p=[0.6, 0.1, 0.1, 0.1, 0.1])
    grid = GridMap(np.zeros((7, 12)), speed=speed, picks=[[1, 1], [5, 1]], stations=[[1, 10], [5, 10]])
    simulator = driver(grid, 2)
    simulator.reset(seed)
    for _ in range(70):
        simulator.step(rng.uniform((0.5, -1.0), 1.0, (1, 2, 2)))
        motion = simulator.robots[0]["motion"]
        row, column = grid.cell(np.stack([motion["x"], motion["y"]], -1).clip(0.01, [11.99, 6.99])).T
        assert (np.abs(motion["speed"]) - speed[row, column]).max() <= 0.1 + 1e-6
