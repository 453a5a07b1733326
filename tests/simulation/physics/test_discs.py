"""Discs and speed limits of the floor: contact, sweeps, lidar, braking by hand and against plain computations."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.reference import OFFSET, on_arcs
from tests.simulation.senses.test_sensing import centre, expected_lidar, lidar
from tests.simulation.worlds import body_at, put, stage
from warehouse_env.config import EnvConfig
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.physics.discs import keeps_off_disc
from warehouse_env.simulation.physics.floor import floor_of
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.sweep import Sweep
from warehouse_env.simulation.physics.zones import most_speed, zones_of
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import ROBOT, every_kind
from warehouse_env.simulation.tasks.assignment import Assignment

F = np.float32
DISCS = np.array([(4.0, 3.0, 0.5), (1.2, 4.7, 0.31), (6.5, 1.0, 0.05), (6.1, 4.4, 1.1), (7.9, 2.6, 0.3)])
FREE = np.zeros((6, 8), dtype=bool)
SHELF = FREE.copy()
SHELF[4, 1:3] = True  # x 1..3, y 1..2
MAP = GridMap(SHELF, picks=[(5, 0), (5, 1)], stations=[(5, 4), (5, 5)], discs=DISCS, name="round")
FLOOR = floor_of(MAP)
inside = st.tuples(st.floats(0.5, 7.5), st.floats(0.5, 5.5))


def gaps(x: float, y: float, heading: float, discs: NDArray[np.float64] = DISCS) -> NDArray[np.float64]:
    """How far [K] the default body, its axle at a point, is from each disc; negative where they overlap."""
    c, s = math.cos(heading), math.sin(heading)
    dx, dy = discs[:, 0] - x + OFFSET * c, discs[:, 1] - y + OFFSET * s
    beyond, aside = np.abs(dx * c + dy * s) - 0.45, np.abs(dy * c - dx * s) - 0.3
    outside = np.hypot(np.maximum(beyond, 0), np.maximum(aside, 0))
    return outside + np.minimum(np.maximum(beyond, aside), 0.0) - discs[:, 2]


@given(inside, st.floats(-math.pi, math.pi))
def test_body_against_discs_agrees_with_the_distance(point: tuple[float, float], heading: float) -> None:
    cx, cy = point
    axle = (cx + OFFSET * math.cos(heading), cy + OFFSET * math.sin(heading), heading)
    apart = gaps(*axle).min()
    assume(abs(apart) > 5e-6 and not touches_shelf_or_rim(cx, cy))
    assert body_touches_shelf(body_at(*axle), FLOOR) == (apart < 0)


def touches_shelf_or_rim(cx: float, cy: float) -> bool:
    near_shelf = 1 - 0.55 < cx < 3.55 and 1 - 0.55 < cy < 2.55
    return near_shelf or not (0.55 < cx < 7.45 and 0.55 < cy < 5.45)


@settings(max_examples=150)
@given(st.integers(0, 10**9), st.floats(-0.03, 0.03), st.sampled_from([0.05, 0.2]))
def test_a_body_touches_a_disc_between_samples_where_dense_sampling_says_so(seed: int, gap: float, dt: float) -> None:
    """One that is about to graze a disc in the middle of a substep, or to pass it closely."""
    rng = np.random.default_rng(seed)
    p = stage(MAP, (0.5, 0.5, 0.0), time_step=dt, substeps=1)._params[0]
    speed, steer = np.full(2, rng.uniform(-1.5, 1.5)), np.full(2, rng.uniform(-1.0, 1.0) * rng.choice([0.0, 1.0]))
    radius, away = float(rng.choice([0.02, 0.3, 1.5])), rng.uniform(-math.pi, math.pi)
    middle = on_arcs(np.zeros(3), speed, steer, dt, 2)[1]
    low, high = 0.0, 4.0  # how far off the disc is, so that there is `gap` half-way
    for _ in range(50):
        far = 0.5 * (low + high)
        disc = np.array([[far * math.cos(away), far * math.sin(away), radius]])
        low, high = (low, far) if gaps(*middle, disc)[0] > gap else (far, high)
    poses = on_arcs(np.zeros(3), speed, steer, dt, 800)
    apart = np.array([gaps(*pose, disc)[0] for pose in poses])
    if min(apart[0], apart[-1]) <= 1e-5:
        return
    bend = abs(math.tan(steer[0])) / 0.6
    way = abs(speed[0]) * dt * (1.0 + float(p["far"]) * bend)
    off = keeps_off_disc(*np.float32(disc[0]), Sweep(*(body_at(*pose) for pose in poses[[0, -1]]), F(0.0)), F(way), p)
    if apart.min() < -1e-5:
        assert not off
    if apart.min() > 2e-5:
        assert off


def rays_to_discs(simulator: Simulator, grow: float) -> NDArray[np.float64]:
    """Metres of each ray to the first disc, inf if it meets none: by the quadratic equation, in float64."""
    cx, cy, heading = centre(simulator, 0)
    found = np.full(simulator.config.sensor.rays, math.inf)
    for k in range(len(found)):
        angle = heading + 2 * math.pi * k / len(found)
        for x, y, radius in simulator.grid.discs.astype(np.float64):
            half = (cx - x) * math.cos(angle) + (cy - y) * math.sin(angle)
            rest = (cx - x) ** 2 + (cy - y) ** 2 - (radius + grow) ** 2
            if rest <= 0.0:
                found[k] = 0.0
            elif half < 0.0 and half * half >= rest:
                found[k] = min(found[k], -half - math.sqrt(half * half - rest))
    return found


STAGE = stage(MAP, (0.5, 0.5, 0.0), action_type="discrete")  # as in the environments: compiled once
WALLS_ONLY = stage(GridMap(SHELF, picks=MAP.picks, stations=MAP.stations), (0.5, 0.5, 0.0))


@settings(max_examples=60)
@given(inside, st.floats(-math.pi, math.pi))
def test_lidar_sees_discs_as_the_quadratic_equation_does(point: tuple[float, float], heading: float) -> None:
    cx, cy = point[0] - OFFSET * math.cos(heading), point[1] - OFFSET * math.sin(heading)
    assume(not touches_shelf_or_rim(cx, cy))
    put(STAGE, 0, (*point, heading))
    got = lidar(STAGE)
    put(WALLS_ONLY, 0, (*point, heading))
    for grow, sign in ((5e-5, -1), (-5e-5, 1)):
        expected = np.minimum(expected_lidar(WALLS_ONLY, 0, grow), rays_to_discs(STAGE, grow))
        assert (sign * (expected + sign * 1e-4 - got) >= 0).all()


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
    zones, p = zones_of(strip(0.5), CONFIG), every_kind(CONFIG, 1.0)
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
    simulator.reset(0, [Assignment(np.array([(1.0, 0.5, 0.0)]), np.array([(0, 19)]))])
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
