"""Messages lost and late, and robots that err.

Who is silent is seen by lidar alone, and keeps the stop that it has published; within the declared bounds a body stays
in its tube and touches nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.physics.test_no_overlap import crowd
from tests.simulation.rights import World
from tests.simulation.safe_stops import assert_all_can_stop
from tests.simulation.test_determinism import MAP, actions_for
from tests.simulation.worlds import drawn, give_line, raw, room, stage
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.simulation.physics.deviation import OFF_PLAN, begin_errors, planned_config, tube
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.traffic_spec import ErrorBounds, TrafficSpec, UncertaintySpec

STANDING = ((5.0, 5.0, 0.0), (7.0, 5.0, math.pi))


def seen(loss: float) -> tuple[Simulator, NDArray[np.float32]]:
    """What each of two robots, nose to nose, sees of the other."""
    changes = {
        "action_type": "discrete",
        "sensor": SensorSpec(predictions=True),
        "uncertainty": UncertaintySpec(loss=loss),
    }
    simulator = stage(room(10, 12), *STANDING, **changes)
    for robot, (x, y, heading) in enumerate(STANDING):
        ahead = np.arange(0.0, 4.0, 0.25)[:, None] * [math.cos(heading), math.sin(heading)]
        give_line(simulator, robot, np.array([x, y]) + ahead)
    return simulator, simulator.step(np.full((1, 2), 5))[0].copy()  # speed 0, on the route


def test_a_silent_robot_is_seen_by_lidar_alone() -> None:
    simulator, heard = seen(0.0)
    _, unheard = seen(1.0)
    of = simulator.layout.slices
    assert (heard[:, of["neighbours"].start + 6] == 1).all()
    assert not unheard[:, of["neighbours"]].any()
    assert (heard[:, of["predictions"]] < 1).any(axis=1).all()
    assert (unheard[:, of["predictions"]] == 1).all()
    for name in ("lidar", "ego", "route"):
        np.testing.assert_array_equal(unheard[:, of[name]], heard[:, of[name]])


@pytest.mark.parametrize(("silent", "held"), [((0, 0), [0, 0]), ((0, 1), [1, 1]), ((1, 0), [1, 0])])
def test_an_unheard_robot_keeps_its_stop_and_others_count_on_it(silent: tuple[int, int], held: list[int]) -> None:
    """Both stop within the same way, so who is 0.1 m ahead is in the way only if it stops now, as unheard it does."""
    poses = (2.0, 1.5, 0.0, 1.5), (3.0, 1.5, 0.0, 1.5)
    simulator = stage(room(3, 30), *poses, traffic=TrafficSpec(shield=True))
    simulator.robots["task"]["age"][0, 1] = 1
    simulator.robots["shield"]["silent"][0] = silent
    simulator.step(raw(simulator, (1.0, 0.0), (1.0, 0.0)))
    assert simulator.robots["shield"]["vetoed"][0].tolist() == held
    np.testing.assert_allclose(simulator.state.speed[0], np.where(held, 1.4, 1.5), atol=1e-6)


def shaken(simulator: Simulator, rng: np.random.Generator, steps: int) -> Iterator[None]:
    """Step by random commands, yield after each step, and check that robots drove and touched nothing."""
    commands = np.zeros((1, simulator.num_agents, 2))
    for _ in range(steps):
        fresh = rng.choice([-1.0, 0.0, 1.0], commands.shape, p=[0.2, 0.1, 0.7])
        commands = np.where(rng.random((*commands.shape[:2], 1)) < 0.3, fresh, commands)
        simulator.step(commands)
        yield
    assert not simulator.robots["totals"]["hits_robot"].any()
    assert not simulator.robots["totals"]["hits_shelf"].any()
    assert simulator.robots["totals"]["distance"].sum() > 0.1


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.sampled_from([0.1, 0.3, 0.9]), st.sampled_from([0.0, 0.5, 5.0]))
def test_whatever_is_lost_nobody_touches_anything(seed: int, loss: float, burst: float) -> None:
    """In a crowd told to drive at random, each of whom must be able to stop clear of all others after every step."""
    rng = np.random.default_rng(seed)
    grid = room(9, 9)
    changes = {"traffic": TrafficSpec(shield=True), "uncertainty": UncertaintySpec(loss=loss, burst=burst)}
    simulator = stage(grid, *crowd(rng, grid, 12, 0.05), **changes)
    simulator.draws.begin(0, [seed])
    for _ in shaken(simulator, rng, 80):
        assert_all_can_stop(simulator)


def test_what_a_silent_robot_is_granted_the_others_learn_a_decision_later() -> None:
    authority = {}
    for silent in (0, 1):
        world = World((8.0, 10.0, 0.0, 1.0), (10.0, 8.0, math.pi / 2, 1.0), ages=(100, 0))
        world.robots["shield"]["silent"][0] = silent
        world.decide()
        authority[silent] = world.robots["traffic"]["authority"].tolist()
        assert world.robots["traffic"]["authority"][0] > 2.0 + 0.3 + 0.75  # over the crossing
    assert authority[0][1] < 2.0  # waits before it
    assert authority[1][1] > authority[0][1]
    world.robots["shield"]["silent"][0] = 0
    assert world.decide().robots["traffic"]["yields_to"].tolist() == [-1, 0]


def test_bursts_last_as_long_as_asked_for_and_lose_as_much() -> None:
    uncertainty = UncertaintySpec(loss=0.25, burst=2.0)  # ten decisions of 0.2 s
    sensor = SensorSpec(predictions=True)
    config = EnvConfig(num_agents=5, planner="astar", action_repeat=2, sensor=sensor, uncertainty=uncertainty)
    simulator = Simulator(config, 8, grid=drawn(MAP))
    simulator.reset(2)
    lost = []
    for actions in actions_for("discrete", 400, 8, 5):
        simulator.step(actions)
        lost.append(simulator.robots["shield"]["silent"].reshape(-1).copy())
    lasted = [len(run) for robot in np.array(lost).T for run in "".join(map(str, robot)).strip("1").split("0") if run]
    assert min(lasted) == 10
    assert all(run % 10 == 0 for run in lasted)  # one may begin when another ends
    assert np.mean(lost) == pytest.approx(0.25, abs=0.05)


ERRORS: dict[str, Any] = {"pose_error": 0.02, "heading_error": math.radians(1.0), "actuation_error": 0.05}
SHIELD = TrafficSpec(shield=True)
DECLARED: dict[str, Any] = {"traffic": SHIELD, "uncertainty": UncertaintySpec(**ERRORS)}


def off_plan(simulator: Simulator) -> NDArray[np.float64]:
    """How far [m] any point of each body is from where it is planned, at most, by its four corners."""
    robot, found = simulator.config.robot, []
    for ahead in (robot.front_overhang, -robot.rear_reach):
        for left in (-robot.width / 2, robot.width / 2):
            points = []
            for r in (simulator.robots, simulator._planned):
                c, s = np.cos(r["motion"]["heading"].astype(float)), np.sin(r["motion"]["heading"].astype(float))
                points.append((r["motion"]["x"] + ahead * c - left * s, r["motion"]["y"] + ahead * s + left * c))
            found.append(np.hypot(points[0][0] - points[1][0], points[0][1] - points[1][1]))
    return np.max(found, axis=0)


@settings(max_examples=15)
@given(st.integers(0, 10**6), st.sampled_from([0.0, 0.3]), st.sampled_from([0.0, 0.3]))
def test_within_the_bounds_bodies_stay_in_their_tubes_and_touch_nothing(seed: int, latency: float, loss: float) -> None:
    rng, grid = np.random.default_rng(seed), room(10, 10)
    changes = DECLARED | {"uncertainty": UncertaintySpec(latency=latency, loss=loss, **ERRORS)}
    simulator = stage(grid, *crowd(rng, grid, 8, 0.2), **changes)
    simulator._planned[...] = simulator.robots  # `stage` puts the bodies, this what is planned
    simulator.draws.begin(0, [seed])
    begin_errors(0, simulator.draws.keys, simulator.deviation.walk, simulator.deviation.bodies, simulator._planned[0])
    most = tube(simulator.config, simulator.config.robot)
    for _ in shaken(simulator, rng, 100):
        assert (off_plan(simulator) < most).all()


def test_the_tube_by_hand() -> None:
    """The farthest point is .75 m behind the axle and .3 m aside; half a metre more goes by a wrong heading."""
    config = EnvConfig(**DECLARED)
    far = math.hypot(0.75, 0.3)
    assert tube(config, config.robot) == pytest.approx(0.02 + (far + 0.5) * math.radians(1.0) + OFF_PLAN)
    robot, wide = planned_config(config).robot, tube(config, config.robot)
    assert (robot.length, robot.width) == pytest.approx((0.9 + 2 * wide, 0.6 + 2 * wide))
    assert robot.rear_reach == pytest.approx(0.75 + wide)
    assert robot.max_acceleration == pytest.approx(0.93)


@pytest.mark.nightly
def test_errors_that_nobody_declared_are_beyond_the_bounds() -> None:
    """Bodies leave their plans by more than is allowed."""
    errors = {"pose_error": 0.1, "heading_error": 0.1, "actuation_error": 0.3}
    uncertainty = UncertaintySpec(**errors, declared=ErrorBounds())
    config = EnvConfig(num_agents=6, planner="astar", traffic=SHIELD, uncertainty=uncertainty)
    simulator = Simulator(config, 1, grid=drawn(MAP))
    simulator.reset(3)
    strays = 0
    for actions in actions_for("discrete", 200, 1, 6):
        simulator.step(actions)
        strays += simulator.robots["shield"]["off_plan"].sum()
    assert strays > 0


def test_what_is_said_comes_into_force_one_latency_later() -> None:
    """0.3 s: three physics steps after it was said, whatever is said in between."""
    changes = {"traffic": SHIELD, "uncertainty": UncertaintySpec(declared=ErrorBounds(latency=0.3))}
    simulator = stage(room(6, 20), (5.0, 3.0, 0.0), **changes)
    speeds = []
    for command in ((1.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)):
        simulator.step(raw(simulator, command))
        speeds.append(float(simulator.state.speed[0, 0]))
    np.testing.assert_allclose(speeds, [0.0, 0.0, 0.0, 0.1, 0.1], atol=1e-6)


@pytest.mark.parametrize(("declared", "drives"), [(0.3, True), (0.0, False)])
def test_messages_later_than_declared_are_lost(declared: float, drives: bool) -> None:
    uncertainty = UncertaintySpec(latency=0.3, declared=ErrorBounds(latency=declared))
    simulator = stage(room(6, 20), (5.0, 3.0, 0.0), traffic=SHIELD, uncertainty=uncertainty)
    simulator.draws.begin(0, [1])
    for _ in range(10):
        simulator.step(raw(simulator, (1.0, 0.0)))
    assert (simulator.robots["shield"]["silent"][0, 0] == 0) == drives
    assert (simulator.state.speed[0, 0] > 0.5) == drives
