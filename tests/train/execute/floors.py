"""Provide small floors and paths for tests of plans."""

from __future__ import annotations

from functools import cache

import numpy as np

from train.execute.motions import DIRECTIONS, Curves
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.simulation.simulator import Simulator


def _floor(name: str, shelves: list[tuple[slice, slice]]) -> GridMap:
    occupied = np.zeros((12, 12), bool)
    for rows, columns in shelves:
        occupied[rows, columns] = True
    return GridMap(occupied, name=name)


OPEN = _floor("open12", [])
BLOCK = _floor("block12", [(slice(3, 5), slice(2, 10)), (slice(7, 9), slice(2, 10))])


@cache
def curves_on(grid: GridMap) -> Curves:
    """Return the curves of a floor, made once for all tests."""
    return Curves(Simulator(EnvConfig(num_agents=1, action_type="raw"), 1, grid=grid))


def random_walk(grid: GridMap, rng: np.random.Generator, moves: int) -> list[Cell]:
    """Return the cells of a random walk."""
    free = {tuple(cell) for cell in grid.free_cells.tolist()}
    cells = [sorted(free)[rng.integers(len(free))]]
    while len(cells) <= moves:
        row, column = cells[-1]
        beside = [(row + a, column + b) for a, b in DIRECTIONS if (row + a, column + b) in free]
        cells.append(beside[rng.integers(len(beside))])
    return cells
