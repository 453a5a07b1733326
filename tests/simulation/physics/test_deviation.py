"""Robots that err: within the declared bounds a body stays in its tube and touches nothing; off, nothing changes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.physics.test_no_overlap import crowd
from tests.simulation.test_determinism import MAP, actions_for
from tests.simulation.worlds import drawn, raw, room, stage
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.physics.deviation import OFF_PLAN, planned_config, tube
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.traffic_spec import ErrorBounds, TrafficSpec, UncertaintySpec

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
    simulator.deviation.begin(0, simulator._planned[0])
    simulator.messages.begin(0)
    commands, most = np.zeros((1, simulator.num_agents, 2)), tube(simulator.config, simulator.config.robot)
    for _ in range(100):
        fresh = rng.choice([-1.0, 0.0, 1.0], commands.shape, p=[0.2, 0.1, 0.7])
        commands = np.where(rng.random((*commands.shape[:2], 1)) < 0.3, fresh, commands)
        simulator.step(commands)
        assert (off_plan(simulator) < most).all()
    assert not simulator.robots["totals"]["hits_robot"].any()
    assert not simulator.robots["totals"]["hits_shelf"].any()
    assert simulator.robots["totals"]["distance"].sum() > 0.1


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
    simulator.messages.begin(0)
    for _ in range(10):
        simulator.step(raw(simulator, (1.0, 0.0)))
    assert (simulator.robots["shield"]["silent"][0, 0] == 0) == drives
    assert (simulator.state.speed[0, 0] > 0.5) == drives
