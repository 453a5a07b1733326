"""One-shot tasks that can all be done: no body parked at a goal cuts another robot off from its own goal.

A robot parks as soon as its front axle is within `arrival_radius` of its goal, at any heading. So its body lies in a
disc around the goal's centre. A body that drives along the grid's lines keeps off that disc on every cell whose centre
is half a body's width further out. Tasks are well-formed if eq. 26 moves over free cells outside the discs of all other
goals join each robot's start and goal. This is the condition of well-formed infrastructures (Cap, Novak, Kleiner &
Selecky 2015) for goals alone, checked exactly on the grid for the worst parking poses. In any order of arrivals, a
robot alone on the floor could then still drive to its goal.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.moves import label_regions

MARGIN = 0.05  # [m] between a passing body and the disc of a parked one


def body_reach(config: EnvConfig) -> float:
    """Return the largest distance [m] of a body's point from the front axle."""
    robot = config.widest_body
    return math.hypot(max(robot.rear_reach, robot.front_overhang), robot.width / 2)


def disc_of(config: EnvConfig, cell: float) -> NDArray[np.int64]:
    """Return int64[K, 2]: where (row, column), from a goal's cell, a parked body may bar a cell of `cell` [m]."""
    off = config.pose_radius if config.arrival == "pose" else config.arrival_radius
    reach = (off + body_reach(config) + config.widest_body.width / 2 + MARGIN) / cell
    steps = np.arange(-math.floor(reach), math.floor(reach) + 1)
    offsets = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    within: NDArray[np.int64] = offsets[(offsets**2).sum(axis=1) < reach * reach]
    return within


def covered(cell: Cell, disc: NDArray[np.int64], shape: tuple[int, ...]) -> tuple[NDArray[np.int64], ...]:
    """Return the cells that a body parked on a cell may bar, as an index into arrays of a floor's shape."""
    cells = disc + cell
    return tuple(cells[((cells >= 0) & (cells < shape)).all(axis=1)].T)


def cut_off(
    grid: GridMap, starts: NDArray[np.int64], goals: NDArray[np.int64], disc: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return bool[N]: robots whose goal bodies parked at the other goals cut off from its start; cells int64[N, 2].

    disc: see `disc_of`.
    """
    discs = [covered(goal, disc, grid.shape) for goal in map(tuple, goals.tolist())]
    bodies, found = np.zeros(grid.shape, np.int32), []  # how many bar a cell
    for cells in discs:
        bodies[cells] += 1
    for cells, start, goal in zip(discs, starts, goals, strict=True):
        bodies[cells] -= 1
        region = label_regions(~grid.closed & (bodies == 0))
        bodies[cells] += 1
        found.append(region[tuple(start)] == 0 or region[tuple(start)] != region[tuple(goal)])
    return np.array(found, dtype=np.bool_)
