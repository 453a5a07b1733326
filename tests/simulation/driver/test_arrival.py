"""Robots that stop at their goals: they come to rest at the end of their routes, and arrive when they stand there."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.simulation.worlds import room
from warehouse_env.config import EnvConfig
from warehouse_env.observation import GOAL, observation_layout
from warehouse_env.simulation.driver.arrival import RESTS, STILL, speed_before
from warehouse_env.simulation.physics.kinematics import approach
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import parameters_of
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.traffic_spec import TrafficSpec

START = Assignment([(2.5, 5.5, 0.0)], [(6, 9)])


def simulator(**changes: object) -> Simulator:
    config = EnvConfig(num_agents=1, planner="astar", keep_right=0.0, max_steps=10**6).replace(**changes)
    sim = Simulator(config, grid=room(12, 12))
    sim.reset_to([START], seed=1)
    return sim


POINT = (9.3, 5.2)


@pytest.mark.parametrize("arrival", ["pass", "stop", "pose"])
@pytest.mark.parametrize("goal", [POINT, (*POINT, 1.0), (*POINT, float("nan"))])
def test_goals_may_be_points_and_poses_whenever_a_robot_has_arrived(arrival: str, goal: tuple[float, ...]) -> None:
    sim = simulator(arrival=arrival)
    sim.reset_to([Assignment([(2.5, 5.5, 0.0)], [goal])], seed=1)
    last = int(sim.state.route_points[0, 0]) - 1
    np.testing.assert_allclose(sim.routes[0, 0, last], POINT, atol=1e-6)
    assert sim.state.goal[0, 0].tolist() == [6, 9]
    off, _ = drive(sim)
    assert off <= (0.05 if arrival == "pose" else 0.5)


def drive(sim: Simulator, steps: int = 300) -> tuple[float, float]:
    """Cruise up to the first arrival; return the metres off the goal and the speed [m/s] at which it came."""
    goal = sim.robots[0, 0]["task"][["goal_x", "goal_y"]].copy()
    for _ in range(steps):
        sim.step(np.full((1, 1), sim.cruise_action))
        if sim.arrivals:
            r = sim.robots[0, 0]
            return float(np.hypot(r["motion"]["x"] - goal["goal_x"], r["motion"]["y"] - goal["goal_y"])), abs(
                float(r["motion"]["speed"])
            )
    raise AssertionError("nobody arrives")


def test_in_passing_a_robot_arrives_at_speed_and_else_it_stands_at_the_end_of_its_route() -> None:
    off, speed = drive(simulator())
    assert 0.3 < off <= 0.5
    assert speed > 1.0
    off, speed = drive(simulator(arrival="stop"))
    assert off < 0.1
    assert speed <= STILL


@given(st.floats(0.0, 5.0), st.floats(0.0, 1.5), st.floats(0.3, 3.0))
def test_who_brakes_before_an_end_stands_there_and_never_beyond(way: float, speed: float, brake: float) -> None:
    p = parameters_of(EnvConfig(), 1.0)
    p["max_acceleration"] = brake
    most = brake * 0.1
    nothing = np.float32(0.0)
    speed = min(speed, float(speed_before(np.float32(way), nothing, nothing, p[0])))  # from which it can stop
    for _ in range(400):
        wanted = nothing if way <= RESTS else speed_before(np.float32(way), nothing, np.float32(speed), p[0])
        after = float(approach(np.float32(speed), wanted, most))
        way, speed = way - 0.05 * (speed + after), after
        assert way > -0.005
    assert speed == 0.0
    assert way <= RESTS + 1e-6


def test_the_observation_tells_the_goal_where_robots_stop_and_is_the_same_before_it() -> None:
    passing = EnvConfig(traffic=TrafficSpec(shield=True))
    one, two = observation_layout(passing), observation_layout(passing.replace(arrival="stop"))
    assert two.size == one.size + GOAL
    assert {name: two.slices[name] for name in one.slices} == one.slices
    sim = simulator(arrival="stop")
    np.testing.assert_allclose(sim.observation[0, 0, -GOAL:], [7.0 / 5.0, 0.0, 0.0, 0.0, 0.0], atol=1e-6)
    braked = False
    while not braked:
        sim.step(np.full((1, 1), sim.cruise_action))
        braked = bool(sim.observation[0, 0, -1])
    r = sim.robots[0, 0]
    assert float(r["task"]["goal_x"] - r["motion"]["x"]) == pytest.approx(
        float(r["motion"]["speed"]) ** 2 / 1.8, abs=0.25
    )
