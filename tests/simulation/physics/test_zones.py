"""Speed limits of the floor: by hand, whatever a robot is told, and whole steps of all kinds of actions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import MapError
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.physics.kinematics import curvature, roll
from warehouse_env.simulation.physics.zones import keep_under, most_speed, zones_of
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import ROBOT, parameters_of

CONFIG = EnvConfig()


def strip(limit: float) -> GridMap:
    """A strip of 20 cells, of which the two in the middle have a limit."""
    speed = np.full((1, 20), np.inf)
    speed[0, 10:12] = limit
    return GridMap(np.zeros((1, 20)), speed=speed)


@kernel
def _most(r, zones, p):
    return most_speed(r[0], zones, p[0])


@kernel
def _drive(r, zones, p, commands):
    """Drive a robot by commands (m/s^2, rad) for physics steps; return float32[T, 3]: where it ends, how fast."""
    out, dt = np.empty((len(commands), 3), np.float32), p[0]["time_step"]
    for k in range(len(commands)):
        acceleration = keep_under(r[0], commands[k, 0], most_speed(r[0], zones, p[0]), zones, p[0])
        speed = min(max(r[0]["motion"]["speed"] + acceleration * dt, p[0]["min_speed"]), p[0]["max_speed"])
        bend = curvature(commands[k, 1], p[0]["wheelbase"])
        way = np.float32(0.5) * (r[0]["motion"]["speed"] + speed) * dt
        r[0]["motion"]["x"], r[0]["motion"]["y"], r[0]["motion"]["heading"] = roll(
            r[0]["motion"]["x"], r[0]["motion"]["y"], r[0]["motion"]["heading"], way, bend
        )
        r[0]["motion"]["speed"], r[0]["motion"]["steer"] = speed, commands[k, 1]
        out[k, 0], out[k, 1], out[k, 2] = r[0]["motion"]["x"], r[0]["motion"]["y"], speed
    return out


def robot_at(x: float, y: float, heading: float = 0.0, speed: float = 0.0) -> Any:
    r = np.zeros(1, ROBOT)
    r["motion"]["x"], r["motion"]["y"], r["motion"]["heading"], r["motion"]["speed"] = x, y, heading, speed
    return r


def test_the_speed_before_in_and_behind_a_zone_by_hand() -> None:
    """At rest 1 m before, in and 0.5 m behind a zone of 0.5 m/s, with braking planned at 0.9 m/s^2."""
    zones, p = zones_of(strip(0.5), CONFIG), parameters_of(CONFIG, 1.0)
    assert zones is not None
    assert zones.squares.shape == (9, 161)
    found = [_most(robot_at(x, 0.5), zones, p) for x in (9.0, 10.0, 11.3, 12.5)]
    wanted = [math.sqrt(0.25 + 1.8), 0.5, 0.5, math.sqrt(0.25 + 0.9)]
    assert found == pytest.approx(wanted, rel=1e-6)
    assert _most(robot_at(2.0, 0.5), zones, p) > 1.5
    assert _most(robot_at(9.95, 0.5, speed=1.0), zones, p) == 0.5  # it will be in the zone


def test_a_robot_brakes_in_time_and_speeds_up_behind() -> None:
    p, zones = parameters_of(CONFIG, 1.0), zones_of(strip(0.5), CONFIG)
    full = np.tile(np.array([[1.0, 0.0]], np.float32), (200, 1))
    way = _drive(robot_at(1.0, 0.5), zones, p, full)
    x, speed = way[:, 0], way[:, 2]
    inside = (x >= 10) & (x <= 12)
    assert speed[inside] == pytest.approx(0.5, abs=1e-3)
    assert speed.max() == 1.5
    assert speed[(x > 8) & (x < 8.8)].min() == 1.5  # 1.11 m before the zone it has to brake, and not sooner
    assert speed[(x > 13.4) & (x < 19)].min() == 1.5


def test_no_limit_that_binds_is_no_zone() -> None:
    assert zones_of(strip(1.5), CONFIG) is None
    assert zones_of(GridMap(np.zeros((1, 20))), CONFIG) is None
    assert strip(np.inf).speed is None
    for wrong in (0.0, -1.0, np.nan):
        with pytest.raises(MapError, match="speed"):
            strip(wrong)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.4, 1.0]), st.sampled_from([0.5, 1.0, 3.0]))
def test_nobody_is_faster_than_its_zone(seed: int, cell: float, acceleration: float) -> None:
    """Whatever it is told: at the end of a step no faster than where it is allows, and one step's braking."""
    rng = np.random.default_rng(seed)
    speed = rng.choice([np.inf, 0.2, 0.5, 0.9, 1.2], (12, 12), p=[0.6, 0.1, 0.1, 0.1, 0.1])
    config = EnvConfig(robot=RobotSpec(max_acceleration=acceleration))
    zones, p = zones_of(GridMap(np.zeros((12, 12)), cell_size=cell, speed=speed), config), parameters_of(config, cell)
    if zones is None:
        return
    steps = 120
    commands = np.empty((steps, 2), np.float32)
    commands[:, 0] = np.repeat(rng.choice([-1.0, 0.0, 1.0, 1.0], steps // 10), 10) * acceleration
    commands[:, 1] = np.cumsum(rng.uniform(-0.15, 0.15, steps)).clip(-1.04, 1.04)  # 1.5 rad/s at most
    way = _drive(robot_at(6 * cell, 6 * cell, rng.uniform(-3, 3)), zones, p, commands)
    column, row = (way[:, :2] / cell).astype(np.int64).T
    inside = (np.minimum(row, column) >= 0) & (np.maximum(row, column) < 12) & (way[:, :2] >= 0).all(axis=1)
    limit = speed[::-1][row[inside], column[inside]]
    assert (np.abs(way[inside, 2]) <= limit + acceleration * config.time_step).all()


def test_whole_steps_keep_limits() -> None:
    speed = np.full((5, 12), np.inf)
    speed[:, 6:8], speed[3, :] = 0.5, 0.8
    grid = GridMap(np.zeros((5, 12)), speed=speed, picks=[[1, 1], [3, 1]], stations=[[1, 10], [3, 10]])
    simulator = Simulator(EnvConfig(num_agents=2, planner="astar", action_type="continuous"), grid=grid)
    simulator.reset(31600001)
    rng, fastest = np.random.default_rng(5), 0.0
    for _ in range(70):
        simulator.step(rng.uniform((0.5, -1.0), 1.0, (1, 2, 2)))
        motion = simulator.robots[0]["motion"]
        row, column = grid.cell(np.stack([motion["x"], motion["y"]], -1).clip(0.01, [11.99, 4.99])).T
        assert (np.abs(motion["speed"]) - speed[row, column]).max() <= 0.1
        fastest = max(fastest, float(motion["speed"].max()))
    assert fastest > 0.6


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
