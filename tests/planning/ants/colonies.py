"""What tests of ant systems share: walks laid by hand, and a checked search."""

from __future__ import annotations

import numpy as np

from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import Plan, make_planner, validate
from warehouse_env.planning.ants.walks import AntFloor, Walks, empty_walks, measure

EAST, SOUTH_EAST, SOUTH, WEST = 0, 7, 6, 4


def walked(floor: AntFloor, *paths: list[int], start: int = 0) -> Walks:
    """Measured walks from a flat cell along the given moves."""
    walks = empty_walks(start, len(paths), len(floor.height))
    walks.steps[:] = [len(path) for path in paths]
    for ant, path in enumerate(paths):
        walks.moves[ant, : len(path)] = path
    measure(floor, walks, 0, len(paths))
    return walks


def search(name: str, grid: GridMap, start: Cell, goal: Cell, seed: int = 0, **parameters: object) -> Plan:
    """A plan by a planner of PLANNERS, valid where one is found."""
    plan = make_planner(name, **parameters).plan(grid, start, goal, np.random.default_rng(seed))
    if plan.found:
        validate(grid, plan.cells, start, goal)
    return plan
