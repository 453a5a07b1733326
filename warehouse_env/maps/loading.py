"""Load the floor of a configuration, fitted to its robots."""

from __future__ import annotations

import multiprocessing
import warnings

from warehouse_env.config import EnvConfig
from warehouse_env.errors import MapWarning
from warehouse_env.maps.fitting import fitted
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout


def load_floor(config: EnvConfig, grid: GridMap | None = None) -> GridMap:
    """Return the floor of a config, or `grid` instead, fitted to the bodies and speeds of its robots.

    Endpoints that they cannot reach raise a MapWarning. The floor stays unchanged if fewer endpoints than robots would
    be left: the caller may place the robots elsewhere.
    """
    if grid is None:
        grid = make_layout(config.layout)
    grid = grid.at_pace(max(robot.max_speed for robot in config.bodies))
    floor, notes = fitted(grid, config.widest_body)
    if len(floor.endpoints[2]) <= config.num_agents < len(grid.endpoints[2]):
        floor, notes = grid, (*notes, "fewer places are left than there are robots, so the floor stays as it is")
    for note in notes if multiprocessing.parent_process() is None else ():  # a worker's parent has warned already
        warnings.warn(f"{grid.name}: {note}", MapWarning, stacklevel=3)
    return floor
