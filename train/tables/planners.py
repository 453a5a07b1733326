"""The floors of `warehouse tables planners`: 200 pairs of cells on each of five."""

from __future__ import annotations

import dataclasses
import zlib

import numpy as np

from train.tables.study import TableSetting, TableTask
from warehouse_env.maps.generators import blocks, random_floor
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout

PAIRS = 200


def movingai_warehouse(aisle: int = 2) -> GridMap:
    """Return the MovingAI map warehouse-10-20-10-2-AISLE (Stern et al. 2019), cell for cell.

    It has 20 rows of 10 shelves of 10 x 2 cells each, aisles and two rims 1 or 2 wide, two wide rims, and a wall
    around: 161 x 63 or 170 x 84 cells.
    """
    inner = blocks(
        40 + 21 * aisle, 150 + 9 * aisle, block_rows=2, block_columns=10, aisle=aisle, cross=aisle, zone_rows=20,
        zone_columns=10, rim_rows=aisle, rim_columns=25, corridor_stations=False,
    )  # fmt: skip
    return GridMap(np.pad(inner.occupied, 1, constant_values=True), name=f"warehouse-10-20-10-2-{aisle}")


def _clutter(share: float, name: str) -> GridMap:
    """Return 46 x 46 cells, a share of them shelves drawn at random; cells that these cut off are filled."""
    return dataclasses.replace(random_floor(46, 46, share=share, seed=0), name=name)


def pairs_on_floors() -> tuple[TableSetting, ...]:
    """Return the floors, each with pairs of distinct cells drawn evenly from its largest region."""
    floors = (make_layout("paper46"), make_layout("narrow"), _clutter(0.20, "clutter20"), _clutter(0.35, "clutter35"))
    made = []
    for grid in (*floors, movingai_warehouse()):
        rng = np.random.default_rng([0, zlib.crc32(grid.name.encode())])
        pairs = [grid.free_cells[rng.choice(len(grid.free_cells), 2, replace=False)].tolist() for _ in range(PAIRS)]
        tasks = (TableTask(grid, (start[0], start[1]), (goal[0], goal[1])) for start, goal in pairs)
        made.append(TableSetting(grid.name, tuple(tasks)))
    return tuple(made)
