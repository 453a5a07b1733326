"""No body ever overlaps another or a shelf, at a sample or between two: judged by float64 polygons on the true arcs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.reference import bodies, deepest_overlap, on_arcs, rectangle, separation, shelves
from tests.simulation.worlds import body_at, drawn, raw, room, stage
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.physics.sweep import Sweep, touch_between
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import every_kind
from warehouse_env.traffic_spec import TrafficSpec

DEEP = 1e-4  # [m] that float32 at ten metres, over a step, is allowed
MAZE = ["......", ".#..#.", "......", "..##..", ".#....", "......"]


def crowd(rng: np.random.Generator, grid: GridMap, most: int, gap: float) -> list[tuple[float, float, float]]:
    """Poses thrown at random that keep `gap` [m] from shelves and each other; at most `most`."""
    walls, (rows, columns) = shelves(grid.occupied), grid.shape
    poses: list[tuple[float, float, float]] = []
    placed = np.empty((0, 4, 2))
    for _ in range(600):
        x, y, heading = rng.uniform(0, columns), rng.uniform(0, rows), rng.uniform(-math.pi, math.pi)
        body = bodies(x, y, heading)
        if separation(body, walls).min() > gap and (not len(placed) or separation(body, placed).min() > gap):
            poses.append((x, y, heading))
            placed = np.concatenate([placed, body[None]])
        if len(poses) == most:
            break
    return poses


def shake(simulator: Simulator, rng: np.random.Generator, steps: int, hold: int) -> tuple[int, int]:
    """Drive all robots by random full commands, each held for about `hold` steps; return (contacts, chains) seen."""
    walls = shelves(simulator.grid.occupied, simulator.grid.cell_size)
    commands = rng.choice([-1.0, 0.0, 1.0], (1, simulator.num_agents, 2), p=[0.25, 0.15, 0.6])
    contacts = chains = 0
    for _ in range(steps):
        fresh = rng.choice([-1.0, 0.0, 1.0], commands.shape, p=[0.25, 0.15, 0.6])
        commands = np.where(rng.random((1, simulator.num_agents, 1)) < 1 / hold, fresh, commands)
        simulator.step(commands)
        assert deepest_overlap(*simulator.state.pose[0].astype(np.float64).T, walls) < DEEP
        contacts += int(simulator.events.touching[0].sum())
        chains += int(simulator.events.touching[0].sum() > 2)
    return contacts, chains


def test_a_crowd_that_collides_in_chains() -> None:
    rng = np.random.default_rng(5)
    grid = drawn(MAZE)
    simulator = stage(grid, *crowd(rng, grid, 14, 0.02))
    contacts, chains = shake(simulator, rng, 150, 6)
    assert contacts > 100
    assert chains > 20
    assert (simulator.robots["totals"]["distance"] > 0.2).mean() > 0.5  # and most of them get about
    assert simulator.robots["totals"]["hits_shelf"].sum() > 3
    assert simulator.robots["totals"]["hits_robot"].sum() > 10


def test_long_tails_that_swing_into_each_other_from_afar() -> None:
    # Tails 1.9 m behind the axle, turned by 83 degrees in one physics step: the centres, 3.16 m apart, come within
    # 0.8 m, mirror images that would cross.
    robot = RobotSpec(length=2.0, width=0.4, front_overhang=0.1, max_steering=1.4)
    turn = 0.1 * 1.5 * math.tan(1.4) / robot.wheelbase
    heading = math.pi / 2 - turn / 2
    poses = []
    for side, angle in ((-1.0, heading), (1.0, math.pi - heading)):
        centre = (8.0 + side * 1.58, 8.0)
        poses.append((centre[0] + 0.9 * math.cos(angle), centre[1] + 0.9 * math.sin(angle), angle, 1.5, side * 1.4))
    simulator = stage(room(16, 16), *poses, robot=robot)
    simulator.step(np.zeros((1, 2, 2)))
    first, second = (
        rectangle(x - 0.9 * math.cos(a), y - 0.9 * math.sin(a), a, 1.0, 0.2)
        for x, y, a in simulator.state.pose[0].tolist()
    )
    assert separation(first, second) > -DEEP


BETWEEN = 40  # samples of a substep
FARTHEST = 4.0  # times the blur [m] of each of two bodies, within which ones that pass may be taken to touch


def in_between(simulator: Simulator, actions: Any) -> NDArray[np.float64]:
    """Step once, a physics step of one substep; return the poses [BETWEEN + 1, N, 3] on the way."""
    before = [np.copy(simulator.state[k][0]).astype(np.float64) for k in range(3)]
    simulator.step(actions)
    after = [np.copy(simulator.state[k][0]).astype(np.float64) for k in range(3)]
    speed, steer = (np.stack([before[k], after[k]], axis=-1) for k in (1, 2))
    poses = on_arcs(before[0], speed, steer, simulator.config.time_step, BETWEEN)
    stopped = (after[0] == before[0]).all(-1)  # put back to where it was
    poses[:, stopped] = before[0][stopped]
    arrived = np.abs(poses[-1, :, :2] - after[0][:, :2]).max()
    assert arrived < DEEP, "the reference drives otherwise than the simulator"
    return poses


def odd_robot(rng: np.random.Generator) -> RobotSpec:
    """A robot of any size, which steers at the rear or at the front."""
    length = rng.uniform(0.4, 2.0)
    return RobotSpec(
        length=length, width=rng.uniform(0.3, 1.2), front_overhang=rng.uniform(0.05, 0.95) * length,
        wheelbase=rng.uniform(0.4, 1.2),
    )  # fmt: skip


@settings(max_examples=250)
@given(st.integers(0, 10**9), st.floats(-0.1, 0.1), st.sampled_from([0.05, 0.2]), st.booleans())
def test_bodies_touch_between_samples_where_dense_sampling_says_so(
    seed: int, gap: float, dt: float, alike: bool
) -> None:
    """Two that are about to pass each other closely, in the middle of a substep, of one size or of two."""
    rng = np.random.default_rng(seed)
    kinds = [RobotSpec(), RobotSpec() if alike else odd_robot(rng)]
    sizes = np.array([(kind.length, kind.width, kind.front_overhang) for kind in kinds]).T
    wheelbases = np.array([kind.wheelbase for kind in kinds])
    p, q = (every_kind(EnvConfig(robot=kind, time_step=dt, substeps=1), 1.0)[0] for kind in kinds)
    speed = rng.uniform(-1.5, 1.5, (2, 1)) + [[0.0, 1.0]] * rng.uniform(-dt, dt, (2, 1))
    if (speed[:, 0] * speed[:, 1] < 0).any():
        return  # turns back
    steer = rng.uniform(-1.0, 1.0, (2, 1)) * rng.choice([0.0, 1.0], (2, 1)) + np.zeros((2, 2))
    pose = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, rng.uniform(-math.pi, math.pi)]])
    middle = bodies(*on_arcs(pose, speed, steer, dt, 2, wheelbases)[1].T, *sizes)
    away = rng.uniform(-math.pi, math.pi)
    for _ in range(40):  # pushed apart until they are `gap` apart half-way
        short = gap - float(separation(middle[0], middle[1]))
        if short < 1e-3:
            break
        push = max(short, 1e-3) * np.array([math.cos(away), math.sin(away)])
        pose[1, :2] += push
        middle[1] += push
    poses = on_arcs(pose, speed, steer, dt, 400, wheelbases)
    apart = separation(bodies(*poses[:, 0].T, *sizes[:, 0]), bodies(*poses[:, 1].T, *sizes[:, 1]))
    if min(apart[0], apart[-1]) <= DEEP:
        return
    sweeps = []
    for robot, kind in enumerate(kinds):
        ends = (body_at(*pose, kind.length, kind.width, kind.front_overhang) for pose in poses[[0, -1], robot])
        sweeps.append(Sweep(*ends, np.float32(0.0)))
    found = touch_between(*sweeps, q["offset"], p, q)
    if apart.min() < -DEEP:
        assert found
    if apart.min() > FARTHEST * 2 * p["blur"] + DEEP:
        assert not found


def test_a_tail_that_swings_out_within_a_substep_touches() -> None:
    """It ends where it began, a centimetre further in between, and its tail two."""
    brisk = RobotSpec(max_acceleration=2.0)
    turns = (5.0, 5.0, 0.0, 0.2, brisk.max_steering)  # the nose to the right, the tail to the left
    simulator = stage(room(12, 12), turns, (4.6, 5.615, 0.0), robot=brisk, substeps=1, time_step=0.2)
    poses = in_between(simulator, raw(simulator, (-2.0, 0.0), (0.0, 0.0)))
    assert simulator.robots["events"]["hit_robot"][0].tolist() == [1, 1]
    assert (poses[-1] == poses[0]).all()


def test_bodies_that_turn_beside_a_corner_touch_it_where_dense_sampling_says_so() -> None:
    """Some only between the ends of their arcs."""
    grid, rng, hits = drawn([".....", ".....", "..#..", ".....", "....."]), np.random.default_rng(1), 0
    walls = shelves(grid.occupied)
    for _ in range(400):
        pose = (rng.uniform(1.0, 4.0), rng.uniform(1.0, 4.0), rng.uniform(-3.0, 3.0))
        speed, steer = rng.choice([-0.5, 1.5]), rng.choice([-1.0, 1.0])
        poses = on_arcs(np.array(pose), np.full(2, speed), np.full(2, steer), 0.2, BETWEEN)
        apart = separation(bodies(*poses.T)[:, None], walls[None]).min(-1)
        if min(apart[0], apart[-1]) <= DEEP or apart.min() > 0.1:
            continue
        simulator = stage(grid, (*pose, speed, steer), substeps=1, time_step=0.2)
        simulator.step(raw(simulator, (0.0, 0.0)))
        hit = bool(simulator.robots["events"]["hit_shelf"][0, 0])
        if abs(apart.min()) > DEEP:
            assert hit == (apart.min() < 0)
        hits += hit
    assert hits > 3


@pytest.mark.parametrize("guarded", [False, True], ids=["contact", "field"])
@settings(max_examples=6)
@given(st.integers(0, 10**6), st.sampled_from([(0.1, 1.5), (0.1, 3.0), (0.2, 1.5)]))
def test_fast_crossings(guarded: bool, seed: int, pace: tuple[float, float]) -> None:
    """Robots that rush about a crowded maze with long substeps and no margin never overlap, at any instant."""
    (dt, fastest), rng, grid = pace, np.random.default_rng(seed), drawn(MAZE)
    fast = RobotSpec(max_speed=fastest, max_acceleration=2.0 * fastest)
    settings_ = {"time_step": dt, "substeps": 1, "robot": fast, "traffic": TrafficSpec(shield=guarded, margin=0.0)}
    simulator = stage(grid, *crowd(rng, grid, 8, 0.05), **settings_)
    walls = shelves(grid.occupied)
    commands = rng.choice([-1.0, 0.0, 1.0], (1, simulator.num_agents, 2))
    for _ in range(30):
        fresh = rng.choice([-1.0, 0.0, 1.0], commands.shape, p=[0.2, 0.1, 0.7])
        commands = np.where(rng.random((1, simulator.num_agents, 1)) < 0.3, fresh, commands)
        for pose in in_between(simulator, commands)[:: BETWEEN // 10]:
            assert deepest_overlap(*pose.T, walls) < DEEP
    if guarded:
        assert not simulator.robots["totals"]["hits_robot"].any()
        assert not simulator.robots["totals"]["hits_shelf"].any()
