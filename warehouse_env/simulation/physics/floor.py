"""The floor as the kernels see it: padded shelves, y up, and a fine field of guaranteed clearance."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import SensorSpec
from warehouse_env.kernel import inline, kernel
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.physics.discs import LISTED, Discs, discs_near, lower_clearance
from warehouse_env.simulation.physics.edges import Edges, edges_of

FINE = 8  # samples of the clearance field per cell side
UNIT = 0.01  # [m] per count of the clearance field, which saturates at 2.55 m


class Floor(NamedTuple):
    """Static arrays of one map."""

    solid: NDArray[np.uint8]  # [H + 2, W + 2], 1 = shelf or outside; row 0 is the rim south of the map
    clearance: NDArray[np.uint8]  # [H * FINE, W * FINE], y up: lower bound of the distance to the nearest obstacle
    cell: np.float32  # [m]
    edges: Edges  # what the lidar sees of all obstacles
    discs: Discs | None  # obstacles that are discs, by the cells that they touch


@inline
def padded_cell(x, y, cell, cells):
    """Return (row, column) of the padded floor's cell that holds a point [m], or is nearest to it.

    cells: an array over the padded floor.
    """
    row, column = int(y / cell) + 1, int(x / cell) + 1
    return min(max(row, 0), cells.shape[0] - 1), min(max(column, 0), cells.shape[1] - 1)


@kernel
def _clearance(solid, cell, fine, unit, out):
    """Fill `out` with floor((distance from the sample's centre - half its diagonal) / unit), within 0..255."""
    rows, columns = out.shape
    step = cell / fine
    reach = int(math.ceil(255.0 * unit / cell)) + 1
    for i in range(rows):
        for j in range(columns):
            y = (i + 0.5) * step
            x = (j + 0.5) * step
            row = i // fine + 1
            column = j // fine + 1
            best = 1e9
            for r in range(max(0, row - reach), min(solid.shape[0], row + reach + 1)):
                dy = max(max((r - 1) * cell - y, y - r * cell), 0.0)
                if dy * dy >= best:
                    continue
                for c in range(max(0, column - reach), min(solid.shape[1], column + reach + 1)):
                    if solid[r, c]:
                        dx = max(max((c - 1) * cell - x, x - c * cell), 0.0)
                        best = min(best, dx * dx + dy * dy)
            distance = math.sqrt(best) - step * math.sqrt(0.5)
            out[i, j] = int(min(max(distance / unit, 0.0), 255.0))


@lru_cache(maxsize=16)
def _floor(
    key: str, walls: bytes, rows: int, columns: int, cell: float, round_ones: bytes, lidar_range: float
) -> Floor:
    solid = np.ones((rows + 2, columns + 2), dtype=np.uint8)
    solid[1:-1, 1:-1] = np.frombuffer(walls, dtype=np.uint8).reshape(rows, columns)[::-1]
    clearance = np.empty((rows * FINE, columns * FINE), dtype=np.uint8)
    _clearance(solid, float(cell), FINE, UNIT, clearance)
    solid.flags.writeable = False
    discs = np.frombuffer(round_ones, dtype=np.float32).reshape(-1, 3)
    if len(discs):
        lower_clearance(clearance, discs, cell / FINE, UNIT)
    clearance.flags.writeable = False
    edges = edges_of(solid, cell, lidar_range, discs)
    return Floor(solid, clearance, np.float32(cell), edges, discs_near(discs, LISTED, solid.shape, cell))


def floor_of(grid: GridMap, lidar_range: float = SensorSpec.lidar_range) -> Floor:
    """Return the kernels' view of a map, with its edges within `lidar_range` [m]; cached by the map's content."""
    rows, columns = grid.shape
    walls = grid.walls.astype(np.uint8).tobytes()
    return _floor(grid.key, walls, rows, columns, grid.cell_size, grid.discs.tobytes(), lidar_range)
