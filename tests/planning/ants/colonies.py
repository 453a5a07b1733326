"""Provide hand-made walks and a checked search for tests of ant systems."""

from __future__ import annotations

import numpy as np

from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import Plan, make_planner, validate
from warehouse_env.planning.ants.walks import AntFloor, Walks, empty_walks, measure

EAST, SOUTH_EAST, SOUTH, WEST = 0, 7, 6, 4


def walked(floor: AntFloor, *paths: list[int], start: int = 0) -> Walks:
    """Return measured walks from a flat cell along the given moves."""
    walks = empty_walks(start, len(paths), len(floor.height))
    walks.steps[:] = [len(path) for path in paths]
    for ant, path in enumerate(paths):
        walks.moves[ant, : len(path)] = path
    measure(floor, walks, 0, len(paths))
    return walks


def search(name: str, grid: GridMap, start: Cell, goal: Cell, seed: int = 0, **parameters: object) -> Plan:
    """Plan with a planner of PLANNERS and validate a found path."""
    plan = make_planner(name, **parameters).plan(grid, start, goal, np.random.default_rng(seed))
    if plan.found:
        validate(grid, plan.cells, start, goal)
    return plan
