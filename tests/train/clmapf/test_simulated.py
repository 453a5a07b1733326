"""An instance of the benchmark as a world of the simulator: lengths, poses and discs by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from train.clmapf.instance import Instance, disc_gap
from train.clmapf.simulated import config_of, world_of
from warehouse_env.simulation.simulator import Simulator


def test_lengths_poses_and_discs_are_scaled() -> None:
    poses = np.array([[10.0, 5.0, 0.0], [40.0, 30.0, math.pi / 2]])
    instance = Instance(
        "one", 50.0, 50.0, ("a", "b"), poses, poses + np.array([1.0, 2.0, 0.0]), np.array([[20.0, 30.0]])
    )
    grid, assignment = world_of(instance)
    assert grid.shape == (29, 29)  # 17 m in cells of 0.6 m
    np.testing.assert_allclose(grid.discs, [[7.0, 10.0, 0.24]], atol=1e-6)
    np.testing.assert_allclose(assignment.pose, [[4.0, 2.5, 0.0], [13.0, 10.0, math.pi / 2]])
    np.testing.assert_allclose(assignment.goal, [[4.3, 3.1, 0.0], [13.3, 10.6, math.pi / 2]])
    robot = config_of(instance).robot
    assert (robot.length, robot.width, robot.front_overhang) == pytest.approx((0.9, 0.6, 0.6))
    assert robot.wheelbase / math.tan(robot.max_steering) == pytest.approx(0.9)  # the least turning radius, 3 units


@pytest.mark.parametrize("gap", [-1e-3, 1e-3])
def test_a_start_touches_a_disc_here_where_it_does_there(gap: float) -> None:
    pose = np.array([[20.0, 20.0, 0.0]])  # the body reaches from 19 to 22, and 1 to each side
    disc = np.array([[22.8 + gap, 20.5]])
    instance = Instance("one", 50.0, 50.0, ("a",), pose, pose + np.array([0.0, 9.0, 0.0]), disc)
    assert disc_gap(pose[0], disc[0]) == pytest.approx(gap)
    grid, assignment = world_of(instance)
    simulator = Simulator(config_of(instance).replace(planner="astar"), grid=grid)
    free = simulator.put(assignment.pose[None], 0.0)
    assert bool(np.all(free)) == (gap > 0)
