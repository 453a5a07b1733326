"""No body ever overlaps a shelf or another body, whatever the robots are told: judged by float64 polygons."""

from __future__ import annotations

import math

import numpy as np

from tests.simulation.reference import bodies, deepest_overlap, rectangle, separation, shelves
from tests.simulation.worlds import drawn, room, stage
from warehouse_env.config import RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.simulator import Simulator

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
