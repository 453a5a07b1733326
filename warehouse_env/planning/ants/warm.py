"""A warm start: plan again from the pheromone of an earlier search after the floor has changed.

Beyond the papers. A converged colony has forgotten nearly all but its trail (0.8^100 of the pheromone is left off it),
so its pheromone is tempered first: pheromone^temper, largest 1.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning.ants.floor import Table
from warehouse_env.planning.ants.system import AntSystem
from warehouse_env.planning.plan import Plan

WARM = 0.05  # temper for a new search: with more, it settles sooner, but too often on the old path


def tempered(pheromone: Table, temper: float) -> Table:
    """Return (pheromone / its largest)^temper float64[C, 8]: 1 leaves its contrasts, 0 forgets everything."""
    if not 0.0 <= temper <= 1.0:
        raise ConfigError(f"temper={temper} must be a share between 0 and 1")
    level: Table = (pheromone / pheromone.max()) ** temper
    return level


def replan(
    system: AntSystem,
    grid: GridMap,
    start: Cell,
    goal: Cell,
    rng: np.random.Generator,
    pheromone: Table | None,
    cost: NDArray[np.float64] | None = None,
    *,
    temper: float = WARM,
) -> tuple[Plan, Table]:
    """Return a plan and the pheromone to begin the next one with, for a floor on which something was moved.

    pheromone: float64[C, 8] that a search to the same goal on a floor of the same shape left behind; None to begin
    from nothing. The start may be another: a robot that has driven on.
    """
    begin = time.perf_counter()
    if pheromone is not None:
        if pheromone.shape != (grid.occupied.size, 8):
            raise ConfigError(f"pheromone of shape {pheromone.shape} is not from a floor of {grid.occupied.size} cells")
        pheromone = tempered(pheromone, temper)
    floor, search = system.search(grid, start, goal, rng, cost, pheromone)
    return system.planned(grid, floor, search, begin), search.pheromone
