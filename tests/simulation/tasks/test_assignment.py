"""Robots stand where they are told to, and go where they are told to."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.simulation.worlds import room
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, MapError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment

POSE = [(2.3, 5.4, 0.3), (8.5, 2.5, math.pi / 2)]
GOAL = [(2, 9), (0, 0)]


def simulator(worlds: int = 1, grid: GridMap | None = None, **changes: object) -> Simulator:
    config = EnvConfig(num_agents=2, planner="astar", action_repeat=2).replace(**changes)
    return Simulator(config, worlds, grid=room(12, 12) if grid is None else grid)


def test_robots_stand_and_go_as_told() -> None:
    sim = simulator(2)
    swapped = Assignment(POSE[::-1], GOAL[::-1])
    sim.reset_to([Assignment(POSE, GOAL), swapped], seed=1)
    np.testing.assert_allclose(sim.state.pose[0], POSE, atol=1e-6)
    np.testing.assert_allclose(sim.state.pose[1], POSE[::-1], atol=1e-6)
    assert sim.state.goal[0].tolist() == [list(goal) for goal in GOAL]
    first = sim.routes[0, 0]
    np.testing.assert_allclose(first[0], sim.grid.centre((6, 2)), atol=0.3)
    last = int(sim.state.route_points[0, 0]) - 1
    np.testing.assert_allclose(first[last], sim.grid.centre(GOAL[0]), atol=1e-3)


@pytest.mark.parametrize(
    ("pose", "goal", "says"),
    [
        (POSE, [(2, 9), (2, 9)], "same goal"),
        (POSE, GOAL[:1], "2 poses and 1 goals"),
        ([(1.0, math.nan, 0.0)], GOAL[:1], "pose=.* 3 finite numbers a robot"),
        (POSE, [(0.5, math.nan), (2.0, 3.0)], "goal=.*a cell.*a point, a pose"),
        (POSE, [(1, 2, 3, 4)] * 2, "goal=.*a cell.*a point, a pose"),
        ([(2.3, 5.4, 0.0), (2.5, 5.4, 0.0)], GOAL, "robot 1 touches"),
        ([(0.2, 5.4, 0.0), (8.5, 2.5, 0.0)], GOAL, "robot 0 touches"),
    ],
)
def test_what_cannot_be_is_an_error(pose: object, goal: object, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        simulator().reset_to([Assignment(pose, goal)])  # type: ignore[arg-type]


def test_an_assignment_must_fit_worlds_robots_and_floor() -> None:
    told = Assignment(POSE, GOAL)
    with pytest.raises(ConfigError, match="2 of type Assignment"):
        simulator(2).reset_to([told])
    with pytest.raises(ConfigError, match="2 robots does not fit num_agents=3"):
        simulator(num_agents=3).reset_to([told])
    with pytest.raises(MapError, match=r"goal of robot 0 .* outside"):
        simulator().reset_to([Assignment(POSE, [(50, 1), (0, 0)])])
    with pytest.raises(ConfigError, match=r"pose: \(50, 2\) is not on the floor of 12 x 12 m"):
        simulator().reset_to([Assignment([POSE[0], (50.0, 2.0, 0.0)], GOAL)])
