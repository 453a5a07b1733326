"""Where a floor's bottlenecks are: where robots wait, and which share of all trips leads through there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.evaluation.places import peaks
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.graph_search import AStarTurns
from warehouse_env.traffic.expected import endpoint_tasks
from warehouse_env.traffic.together import Task

TRIPS = 300  # drawn to stand for all
MOST = 5  # places named
RADIUS = 2  # [cells] that a place reaches from its middle


class Bottleneck(NamedTuple):
    """A place where robots wait."""

    cell: Cell
    x: float  # [m]
    y: float
    waiting: float  # [s/h] within RADIUS
    share: float  # of all waiting on the floor
    trips: float  # share of trips through its busiest cell


def draw_trips(grid: GridMap, seed: int) -> list[Task]:
    """Return trips between pick faces and stations, as lifelong robots get them."""
    return endpoint_tasks(grid, TRIPS, np.random.default_rng([seed, 0]))


def plan_trips(grid: GridMap, trips: Sequence[Task]) -> list[NDArray[np.int64]]:
    """Return the cells int[L, 2] of a shortest route with the fewest turns for each trip; PlanError where is none."""
    planner, rng = AStarTurns(), np.random.default_rng(0)
    return [planner.plan(grid, start, goal, rng).cells for start, goal in trips]


def traffic(routes: Sequence[NDArray[np.int64]], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return float64[H, W, 8]: the share of routes that leave a cell by each move of MOVES; the last cell by none."""
    flow = np.zeros((*shape, len(MOVES)))
    number = {(int(row), int(column)): k for k, (row, column) in enumerate(MOVES)}
    for route in routes:
        for (row, column), step in zip(route[:-1], np.diff(route, axis=0), strict=True):
            flow[row, column, number[int(step[0]), int(step[1])]] += 1.0
    return flow / max(1, len(routes))


def passing(routes: Sequence[NDArray[np.int64]], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return float64[H, W]: the share of routes that visit a cell."""
    visits = np.zeros(shape)
    for route in routes:
        cells = np.unique(route, axis=0)
        visits[cells[:, 0], cells[:, 1]] += 1.0
    return visits / max(1, len(routes))


def bottlenecks(grid: GridMap, waiting: NDArray[np.float64], visits: NDArray[np.float64]) -> list[Bottleneck]:
    """Return the places [at most MOST] where most time is spent waiting [s/h], worst first; visits: as `passing`."""
    found = []
    for row, column, heat in peaks(waiting, MOST, RADIUS):
        around = (slice(max(0, row - RADIUS), row + RADIUS + 1), slice(max(0, column - RADIUS), column + RADIUS + 1))
        x, y = grid.centre((row, column)).tolist()
        found.append(Bottleneck((row, column), x, y, heat, heat / float(waiting.sum()), float(visits[around].max())))
    return found
