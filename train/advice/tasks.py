"""Tasks drawn as for lifelong robots, to stand for the traffic on a floor."""

from __future__ import annotations

import numpy as np

from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap

Task = tuple[Cell, Cell]


def endpoint_tasks(grid: GridMap, count: int, rng: np.random.Generator) -> list[Task]:
    """Return tasks between pick faces and stations, alternating in direction; ConfigError if a floor has too few.

    Endpoints are dealt in random order, repeatedly if there are fewer than tasks.
    """
    if len(np.unique(np.concatenate([grid.picks, grid.stations]), axis=0)) < 2:
        raise ConfigError(f"map {grid.name!r} has a single endpoint; a task needs two")
    decks = [rng.permutation(cells).tolist() for cells in (grid.picks, grid.stations)]
    tasks: list[Task] = []
    for k in range(2 * count):
        pick, station = (tuple(deck[k % len(deck)]) for deck in decks)
        if pick != station and len(tasks) < count:
            tasks.append((pick, station) if len(tasks) % 2 else (station, pick))
    return tasks
