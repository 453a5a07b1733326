"""Kernels that convert metres and cells where robots may stand anywhere; GridMap says the same for arrays."""

import numpy as np

from warehouse_env.kernel import inline, kernel, part


@inline
def centre_of(row, column, rows, size):
    """Return the centre (x, y) [m] of a cell of a map with so many rows and cells of this size [m]."""
    return (column + 0.5) * size, (rows - 1 - row + 0.5) * size


@part
def standing_cell(x, y, occupied, free, size):
    """Return the cell (row, column) from which a robot at (x, y) [m] plans (GridMap.standing).

    occupied: bool[H, W]; free: int64[F, 2], GridMap.free_cells; size [m].
    """
    rows, columns = occupied.shape
    row = np.int64(min(max(rows - 1 - np.floor(y / size), 0.0), rows - 1.0))
    column = np.int64(min(max(np.floor(x / size), 0.0), columns - 1.0))
    if not occupied[row, column]:
        return row, column
    best, nearest = np.inf, 0
    for k in range(len(free)):
        there_x, there_y = centre_of(free[k, 0], free[k, 1], rows, size)
        away = (there_x - x) * (there_x - x) + (there_y - y) * (there_y - y)
        if away < best:
            best, nearest = away, k
    return free[nearest, 0], free[nearest, 1]


@kernel
def standing_cells(points, occupied, free, size, cells):
    """Write the cells int64[K, 2] of points float64[K, 2] [m]; see `standing_cell`."""
    for k in range(len(points)):
        cells[k, 0], cells[k, 1] = standing_cell(points[k, 0], points[k, 1], occupied, free, size)
