"""Robots astray get another route from where they are, whatever options are on."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.simulation.worlds import drawn, put, room
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.simulation.traffic.off_route import far_off

WALL = "#" * 20
ROOMS = drawn(["." * 32] + [f"......{WALL}......"] * 5)  # joined by an aisle of one cell, from y = 5 to y = 6
GOAL = (5, 30)
STILL = np.array([[EnvConfig().speed_levels.index(0.0) * len(EnvConfig().lateral_offsets)]])


def simulator_at(x: float, y: float, heading: float, reroute: bool = False) -> Simulator:
    """One robot that was given a route in the eastern room and is somewhere else now."""
    config = EnvConfig(
        num_agents=1, planner="astar", tasks="one_shot", action_repeat=2, traffic="routes" if reroute else "none"
    )
    simulator = Simulator(config, grid=ROOMS)
    simulator.reset_to([Assignment(np.array([[27.5, 4.5, -1.5]]), np.array([GOAL]))], [1])
    put(simulator, 0, (x, y, heading))
    return simulator


@pytest.mark.parametrize("reroute", [False, True])
def test_who_is_far_from_its_route_gets_another_and_arrives(reroute: bool) -> None:
    simulator = simulator_at(2.5, 0.8, math.pi, reroute)
    for _ in range(500):
        simulator.step(np.full((1, 1), simulator.cruise_action))
    assert simulator.robots["totals"]["reroutes"][0, 0] >= 1
    assert simulator.robots["task"]["alive"][0, 0] == 0  # it is there


@pytest.mark.parametrize("reroute", [False, True])
@pytest.mark.parametrize("believed", [(-0.4, 3.0), (32.4, 3.0), (2.5, -0.4), (2.5, 6.4), (10.0, 3.0)])
def test_a_robot_that_believes_to_be_off_the_floor_or_in_a_shelf_gets_a_route(
    believed: tuple[float, float], reroute: bool
) -> None:
    simulator = simulator_at(*believed, 0.0, reroute)
    simulator.robots["clocks"]["standing_time"] = simulator.robots["clocks"]["waiting_time"] = 9.0
    assert simulator.dispatcher.reroute(simulator.steps) == [0]
    line = simulator.routes[0, 0, : simulator.robots["on_route"]["points"][0, 0]]
    np.testing.assert_allclose(line[-1], simulator.grid.centre(np.array(GOAL)), atol=1e-3)


def test_astray_in_the_cell_of_its_goal_it_goes_on_to_its_centre() -> None:
    simulator = simulator_at(30.05, 0.95, -1.5)  # in the goal's cell, but too far from its centre to have arrived
    simulator.dispatcher.give_line(0, 0, np.array([[2.0, 5.5], [2.5, 5.5]], np.float32))
    for _ in range(10):
        simulator.step(STILL)
    assert simulator.robots["on_route"]["points"][0, 0] == 2
    for _ in range(100):
        simulator.step(np.full((1, 1), simulator.cruise_action))
    assert simulator.robots["totals"]["reroutes"][0, 0] >= 1
    assert simulator.robots["task"]["alive"][0, 0] == 0


def test_who_drives_or_is_near_keeps_its_route() -> None:
    simulator = simulator_at(28.0, 5.0, 0.5)
    for _ in range(20):
        simulator.step(STILL)
    assert simulator.robots["totals"]["reroutes"][0, 0] == 0
    put(simulator, 0, (26.6, 0.6, 0.5, 0.5))  # far, but it drives
    simulator.robots["clocks"]["standing_time"] = 9.0
    simulator.step(STILL)
    assert simulator.robots["totals"]["reroutes"][0, 0] == 0
    for _ in range(10):
        simulator.step(STILL)
    assert simulator.robots["totals"]["reroutes"][0, 0] == 1  # it has come to a halt there


@pytest.mark.parametrize(("offset", "cell", "far"), [(1.2, 1.0, 1.5), (3.0, 1.0, 3.3), (0.6, 4.0, 4.0)])
def test_an_offset_and_the_way_from_a_cells_centre_are_not_astray(offset: float, cell: float, far: float) -> None:
    config = EnvConfig(lateral_offsets=(0.0, offset, -offset))
    assert far_off(config, cell) == pytest.approx(far)


def test_who_stands_at_a_wide_offset_keeps_its_route() -> None:
    config = EnvConfig(num_agents=1, planner="astar", lateral_offsets=(0.0, 2.5), keep_right=0.0)
    simulator = Simulator(config, grid=room(12, 24))
    simulator.reset_to([Assignment(np.array([[2.5, 3.5, 0.0]]), np.array([(8, 21)]))], [1])
    put(simulator, 0, (8.0, 6.0, 0.0))  # 2.5 m to the left of its route along y = 3.5
    simulator.robots["on_route"]["position"] = 5.5
    stop = np.full((1, 1), config.speed_levels.index(0.0) * 2 + 1)
    for _ in range(30):
        simulator.step(stop)
    assert simulator.robots["totals"]["reroutes"][0, 0] == 0
