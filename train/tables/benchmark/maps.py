"""The five floors of the benchmark, the pairs of cells that are planned on them, and their clearance."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from train.evaluation.planning_runs import Task, make_task
from warehouse_env.errors import MapError, unknown_name
from warehouse_env.maps.generators import blocks, random_floor
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout

_CLUTTER_SEED = 0


def clutter(share: float, name: str) -> GridMap:
    """Return 46 x 46 cells, a share of them shelves drawn at random; what these cut off is filled."""
    return dataclasses.replace(random_floor(46, 46, share=share, seed=_CLUTTER_SEED), name=name)


def movingai_warehouse(aisle: int = 2) -> GridMap:
    """Return the MovingAI map warehouse-10-20-10-2-AISLE (Stern et al. 2019), cell for cell.

    It is regular: 20 rows of 10 shelves, each 10 x 2 cells, aisles and two rims 1 or 2 wide, two wide rims, and a wall
    around: 161 x 63 or 170 x 84 cells.
    """
    inner = blocks(
        40 + 21 * aisle, 150 + 9 * aisle, block_rows=2, block_columns=10, aisle=aisle, cross=aisle, zone_rows=20,
        zone_columns=10, rim_rows=aisle, rim_columns=25, corridor_stations=False,
    )  # fmt: skip
    return GridMap(np.pad(inner.occupied, 1, constant_values=True), name=f"warehouse-10-20-10-2-{aisle}")


MAPS: dict[str, Callable[[], GridMap]] = {
    "paper46": lambda: make_layout("paper46"),
    "narrow": lambda: make_layout("narrow"),
    "clutter20": lambda: clutter(0.20, "clutter20"),
    "clutter35": lambda: clutter(0.35, "clutter35"),
    "warehouse-10-20-10-2-2": movingai_warehouse,
}


@cache
def make_map(name: str) -> GridMap:
    """Return a map of MAPS, or one from a MovingAI file; ConfigError or MapError where there is none."""
    if name in MAPS:
        return MAPS[name]()
    if name.lower().endswith(".map"):
        return make_layout(name)
    raise unknown_name("map of the benchmark", name, MAPS)


@cache
def make_tasks(name: str, count: int, seed: int) -> tuple[Task, ...]:
    """Return `count` pairs of distinct cells of a map with their exact lengths; the first ones are those of any count.

    Cells are drawn evenly from the largest region. MapError on a map with one free cell.
    """
    grid = make_map(name)
    cells = grid.free_cells
    if len(cells) < 2:
        raise MapError(f"map {name!r} has no two connected free cells to plan between")
    rng = np.random.default_rng([seed, zlib.crc32(Path(name).stem.encode())])
    pairs = [cells[rng.choice(len(cells), 2, replace=False)].tolist() for _ in range(count)]
    return tuple(make_task(grid, f"{number}", (a[0], a[1]), (b[0], b[1])) for number, (a, b) in enumerate(pairs))


@cache
def clearance_field(name: str) -> NDArray[np.float64]:
    """Return the clearance of every cell of a map."""
    return clearance_of(make_map(name).occupied)


def clearance_of(occupied: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return float64[H, W], the distance [cells] of each cell's centre from the nearest shelf cell or the map's edge.

    On a path of legal moves the least distance is that of one of its cells: a diagonal move passes no shelf closer.
    """
    solid = np.pad(occupied, 1, constant_values=True)
    rows, columns = solid.shape
    up_down = np.full(solid.shape, np.inf)  # to the nearest shelf cell of the same column
    for row in range(rows):
        apart = np.maximum(np.abs(np.arange(rows) - row) - 0.5, 0.0)
        np.minimum(up_down, np.where(solid[row], apart[:, None], np.inf), out=up_down)
    nearest = np.full(solid.shape, np.inf)
    for column in range(columns):
        apart = np.maximum(np.abs(np.arange(columns) - column) - 0.5, 0.0)
        np.minimum(nearest, np.hypot(up_down[:, column, None], apart), out=nearest)
    return nearest[1:-1, 1:-1]
