"""The protective field: whatever robots are told, and whatever befalls their routes, nobody touches anything."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents import policy_config
from tests.simulation.physics.test_no_overlap import MAZE, crowd
from tests.simulation.reference import bodies, separation
from tests.simulation.safe_stops import checked as checked  # a fixture
from tests.simulation.worlds import drawn, put, raw, room, stage
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.simulation.physics import contact, stops
from warehouse_env.simulation.physics.kinematics import braking
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.traffic import shield
from warehouse_env.traffic_spec import TrafficSpec

pytestmark = pytest.mark.usefixtures("checked")  # all robots can stop after each step
FULL = (1.0, 0.0)  # raw: accelerate, steering held
ROUNDING = 1e-5  # [m] that float32 at ten metres is allowed


def guarded(grid: Any, *poses: Any, margin: float = TrafficSpec.margin, **changes: Any) -> Simulator:
    return stage(grid, *poses, **{"traffic": TrafficSpec(shield=True, margin=margin), **changes})


def least_gap(simulator: Simulator) -> float:
    """Lower bound [m] of the distance of the nearest two robots."""
    robots = bodies(*simulator.state.pose[0].astype(np.float64).T)
    first, second = np.triu_indices(len(robots), 1)
    return float(separation(robots[first], robots[second]).min())


def drive_on(simulator: Simulator) -> None:
    for _ in range(200):
        simulator.step(raw(simulator, FULL, (0.0, 0.0)))


def untouched(simulator: Simulator) -> bool:
    return not (simulator.robots["totals"]["hits_robot"].any() or simulator.robots["totals"]["hits_shelf"].any())


def test_a_robot_stops_before_one_that_stands() -> None:
    simulator = guarded(room(3, 20), (2.0, 1.5, 0.0), (15.0, 1.5, 0.0), margin=0.05)
    drive_on(simulator)
    # The tail of the one that stands is 0.75 m behind its axle, the nose of the other 0.15 m ahead.
    gap = 15.0 - 0.75 - 0.15 - float(simulator.robots["motion"]["x"][0, 0])
    assert 0.05 <= gap + ROUNDING < 0.06
    assert untouched(simulator)
    robot = simulator.robots[0, 0]
    assert (robot["shield"]["vetoed"], robot["shield"]["vetoed_by"], robot["motion"]["speed"]) == (1, 1, 0.0)
    assert robot["shield"]["vetoed_time"] > 1.0


def test_a_robot_stops_before_a_shelf() -> None:
    simulator = guarded(room(3, 10), (2.0, 1.5, 0.0))
    for _ in range(200):
        simulator.step(raw(simulator, FULL))
    assert 0.0 < 10.0 - 0.15 - float(simulator.robots["motion"]["x"][0, 0]) < 0.01
    assert untouched(simulator)
    assert (simulator.robots["shield"]["vetoed"][0, 0], simulator.robots["shield"]["vetoed_by"][0, 0]) == (1, -1)


def test_two_head_on_stop_before_they_meet() -> None:
    simulator = guarded(room(3, 30), (2.0, 1.5, 0.0), (28.0, 1.5, math.pi), margin=0.1)
    fastest = 0.0
    for _ in range(200):
        simulator.step(raw(simulator, FULL, FULL))
        fastest = max(fastest, float(simulator.state.speed.min()))
    assert fastest == 1.5
    assert 0.1 - ROUNDING <= least_gap(simulator) < 0.12
    assert untouched(simulator)


def test_one_may_follow_close_behind_another_that_drives() -> None:
    # Both stop within the same way, so that the margin is all they need, once the one ahead has committed.
    simulator = guarded(room(3, 30), (2.0, 1.5, 0.0, 1.5), (3.0, 1.5, 0.0, 1.5))
    simulator.robots["task"]["age"][0, 1] = 1
    for _ in range(100):
        simulator.step(raw(simulator, FULL, FULL))
        assert simulator.robots["shield"]["vetoed"][0, 0] == 0
        if simulator.robots["motion"]["x"][0, 1] > 25.0:
            break
    assert simulator.state.speed.tolist() == [[1.5, 1.5]]


@pytest.mark.parametrize("first", [0, 1])
def test_the_robot_longest_on_its_way_goes_first(first: int) -> None:
    simulator = guarded(room(20, 20), (8.0, 10.0, 0.0), (10.0, 8.0, math.pi / 2))
    simulator.robots["task"]["age"][0, first] = 100
    for _ in range(40):
        simulator.step(raw(simulator, FULL, FULL))
    other = 1 - first
    assert simulator.robots["totals"]["distance"][0, first] > simulator.robots["totals"]["distance"][0, other] + 1.0
    assert simulator.robots["motion"]["x" if first == 0 else "y"][0, first] > 12.0
    assert untouched(simulator)


def test_robots_nearer_than_the_margin_may_part_but_not_approach() -> None:
    simulator = guarded(room(3, 20), (5.0, 1.5, 0.0), (5.91, 1.5, 0.0), margin=0.2)
    for _ in range(10):
        simulator.step(raw(simulator, FULL, (0.0, 0.0)))
    assert simulator.state.pose[0, 0, 0] == 5.0
    for _ in range(30):
        simulator.step(raw(simulator, (0.0, 0.0), FULL))
    assert simulator.state.pose[0, 1, 0] > 8.0


def test_robots_that_arrive_under_one_shot_tasks_brake_to_their_place() -> None:
    simulator = guarded(room(3, 20), (5.0, 1.5, 0.0, 1.5), (5.97, 1.5, 0.0, 1.5), tasks="one_shot")
    simulator.robots[0, 1]["task"]["goal_x"], simulator.robots[0, 1]["task"]["goal_y"] = 8.0, 1.5
    for _ in range(60):
        simulator.step(raw(simulator, FULL, FULL))
    assert simulator.terminated[0].tolist() == [False, True]
    assert simulator.state.speed[0].tolist() == [0.0, 0.0]
    assert 8.0 < simulator.state.pose[0, 1, 0] < 9.0  # half a metre before the goal it arrives, 1.13 m on it stands
    assert untouched(simulator)


def shake(simulator: Simulator, rng: np.random.Generator, steps: int) -> None:
    """Random commands at full strength, half of them held over from step to step."""
    shape = (1, simulator.num_agents)
    discrete = simulator.config.action_type == "discrete"
    if not discrete:
        shape += (2,)  # type: ignore[assignment]
    actions = np.zeros(shape)
    for _ in range(steps):
        fresh = rng.integers(0, 20, shape) if discrete else rng.choice([-1.0, 0.0, 1.0], shape, p=[0.2, 0.1, 0.7])
        actions = np.where(rng.random(shape) < 0.3, fresh, actions)
        simulator.step(actions.astype(np.int64) if discrete else actions)


def random_floor(rng: np.random.Generator) -> Any:
    """Shelves anywhere but on every third row and in a column, so that all free cells hang together."""
    occupied = rng.random((7, 9)) < rng.choice([0.0, 0.3, 0.6])
    occupied[[0, 3, 6]] = False
    occupied[:, 0] = False
    return drawn(["".join("#" if shelf else "." for shelf in row) for row in occupied])


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.sampled_from([1, 2, 3]), st.sampled_from([0.0, 0.01, 0.1]))
def test_random_commands_on_random_floors(seed: int, substeps: int, margin: float) -> None:
    rng = np.random.default_rng(seed)
    grid = random_floor(rng)
    poses = crowd(rng, grid, 12, 0.11)
    simulator = guarded(grid, *poses, substeps=substeps, traffic=TrafficSpec(shield=True, margin=margin))
    for k in range(len(poses)):
        simulator.robots[0, k]["task"]["age"] = rng.integers(0, 3)
    shake(simulator, rng, 60)
    assert untouched(simulator)
    assert len(poses) < 2 or least_gap(simulator) > margin - ROUNDING


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.sampled_from([1, 2, 3]), st.sampled_from([0.5, 1.03, 1.047]))
def test_the_field_samples_the_poses_that_bodies_take(seed: int, substeps: int, steer: float) -> None:
    """Steering that reaches its lock between two substeps of the command bends the next ones more, not the same."""
    rng = np.random.default_rng(seed)
    pose = (15.0, 15.0, rng.uniform(-3.0, 3.0), rng.uniform(-0.5, 1.5), rng.choice([-steer, steer]))
    command = (rng.uniform(-1.0, 1.0), rng.uniform(-1.5, 1.5))
    simulator = guarded(room(30, 30), pose, substeps=substeps)
    p, body = simulator._params[0], simulator.robots[0]
    paths, outlines, marks, _ = shield.scratch(1, p)
    motion = np.zeros((contact.MOTION, 1), np.float32)
    contact.load(body, 0, *np.float32(command), p, simulator._floor, motion)
    rates = motion[contact.ACCELERATION, 0], motion[contact.STEER_RATE, 0]
    stops.sample(1, 0, (*rates, substeps), motion, paths, outlines, marks, p)
    for n in range(substeps, marks[stops.SAMPLES, 1], substeps):
        simulator.step(
            raw(simulator, command if n == substeps else (float(braking(body["motion"]["speed"][0], p)), 0.0))
        )
        centre = [
            body["motion"]["x"] - p["offset"] * body["motion"]["cos"],
            body["motion"]["y"] - p["offset"] * body["motion"]["sin"],
        ]
        taken = np.concatenate([*centre, body["motion"]["cos"], body["motion"]["sin"]])
        assert paths[1, n, : stops.WAY] == pytest.approx(taken, abs=ROUNDING)


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.sampled_from([0.2, 1.0]))
def test_an_outline_holds_all_that_a_motion_sweeps(seed: int, front: float) -> None:
    """Rear-steered bodies swing their tails, front-steered ones their noses."""
    rng = np.random.default_rng(seed)
    steer, command = rng.uniform(-1.0, 1.0), np.float32([rng.uniform(-1.0, 1.0), rng.uniform(-1.5, 1.5)])
    robot = RobotSpec(length=1.2, wheelbase=0.8, front_overhang=front)
    simulator = guarded(room(30, 30), (15.0, 15.0, rng.uniform(-3.0, 3.0), rng.uniform(-0.5, 1.5), steer), robot=robot)
    p, motion = simulator._params[0], np.zeros((contact.MOTION, 1), np.float32)
    paths, outlines, marks, _ = shield.scratch(1, p)
    contact.load(simulator.robots[0], 0, *command, p, simulator._floor, motion)
    stops.outline_trial(0, *command, motion, outlines, p)
    stops.sample(1, 0, (*command, p["substeps"]), motion, paths, outlines, marks, p)
    c, s = outlines[stops.AXIS_COS, 1], outlines[stops.AXIS_SIN, 1]
    for x, y, cos, sin in paths[1, : marks[stops.SAMPLES, 1], : stops.WAY].astype(float):
        for along, aside in ((0.6, 0.3), (0.6, -0.3), (-0.6, 0.3), (-0.6, -0.3)):
            dx = x + along * cos - aside * sin - outlines[stops.MIDDLE_X, 1]
            dy = y + along * sin + aside * cos - outlines[stops.MIDDLE_Y, 1]
            assert abs(dx * c + dy * s) <= outlines[stops.LONG, 1] + ROUNDING
            assert abs(dy * c - dx * s) <= outlines[stops.WIDE, 1] + ROUNDING


@settings(max_examples=12)
@given(st.integers(0, 10**6), st.sampled_from(["discrete", "continuous"]), st.booleans(), st.booleans())
def test_tasks_and_routes_that_change_while_robots_brake(seed: int, kind: Any, one_shot: bool, ends: bool) -> None:
    rng = np.random.default_rng(seed)
    config = EnvConfig(
        num_agents=7, action_type=kind, planner="astar", action_repeat=2, arrival_radius=1.5,
        traffic=TrafficSpec(shield=True), tasks="one_shot" if one_shot else "lifelong", terminate_on_collision=ends,
    )  # fmt: skip
    simulator = Simulator(config, grid=drawn(MAZE))
    simulator.reset(seed=seed)
    for _ in range(12):
        shake(simulator, rng, 6)
        if not one_shot:
            robot = int(rng.integers(0, 7))
            row, column = simulator.state.goal[0, robot].tolist()
            back = simulator.route_book.route((row, column), (0, 0))  # from the goal: across the floor
            simulator.dispatcher.give_task(0, robot, (0, 0), back)
    assert untouched(simulator)


def test_the_check_finds_what_a_shield_lets_through() -> None:
    simulator = guarded(room(3, 20), (2.0, 1.5, 0.0), (9.0, 1.5, 0.0))
    simulator._params["field_margin"] = -1.0  # a shield that bodies may run through
    with pytest.raises(AssertionError, match="world 0: robot 1 cannot stop clear of robot 0"):
        drive_on(simulator)
    assert untouched(simulator)  # found while there was still a way to go
    simulator = guarded(room(3, 20), (18.9, 1.5, 0.0))
    put(simulator, 0, (18.9, 1.5, 0.0, 1.5))
    with pytest.raises(AssertionError, match="robot 0 cannot stop clear of a shelf"):
        simulator.step(raw(simulator, FULL))


def test_what_a_policy_sees_of_the_field() -> None:
    config = policy_config("ppo", EnvConfig(num_agents=3, planner="astar"))
    plain, under = Simulator(config), Simulator(config.replace(traffic=TrafficSpec(shield=True)))
    field = under.layout.slices["field"]
    assert (under.layout.size, field) == (plain.layout.size + 2, slice(plain.layout.size, plain.layout.size + 2))
    assert "field" not in plain.layout.slices
    plain.reset(seed=1)
    under.reset(seed=1)
    np.testing.assert_array_equal(under.observation[..., : field.start], plain.observation)
    assert not under.observation[..., field].any()
    simulator = guarded(room(3, 20), (2.0, 1.5, 0.0), (15.0, 1.5, 0.0), action_repeat=2)
    for _ in range(100):
        simulator.step(raw(simulator, FULL, (0.0, 0.0)))
    seconds = float(simulator.robots["shield"]["vetoed_time"][0, 0])
    assert 1.0 < seconds < 20.0
    np.testing.assert_allclose(simulator.observation[0, :, -2:], [[1.0, min(seconds, 5.0) / 5.0], [0.0, 0.0]])


def test_a_robot_that_is_held_where_it_stands_may_steer() -> None:
    """Its tail would swing into the other; with its wheels straight it can go, so it must be able to turn them."""
    simulator = guarded(room(12, 12), (5.0, 6.0, 0.0), (4.75, 5.379, 0.0))
    simulator.robots["motion"]["steer"][0, 0] = -simulator.config.robot.max_steering
    held = 0
    for _ in range(40):
        simulator.step(np.array([[[1.0, 1.0], [0.0, 0.0]]], np.float32))
        held += int(simulator.robots["shield"]["vetoed"][0, 0])
    assert held > 0
    assert simulator.robots["motion"]["x"][0, 0] > 5.05
    assert simulator.robots["totals"]["hits_robot"].sum() == 0
