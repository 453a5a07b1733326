"""What a floor loses by its discs' being whole cells for planners and goals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.discs import cells_near
from warehouse_env.maps.endpoints import largest_region
from warehouse_env.maps.grid_map import GridMap

_SAMPLES = 16  # of a cell's side, by which floor that is lost is counted


def lost(grid: GridMap) -> str:
    """Say what a floor loses by its discs' being whole cells for planners; empty where there are no discs."""
    if not len(grid.discs):
        return ""
    round_only = grid.occupied & ~grid.walls
    area, closed = grid.cell_size**2, int(round_only.sum())
    free = closed * area - _round_area(grid, round_only)
    before = largest_region(~grid.walls) & ~round_only
    cut = int(before.sum() - len(grid.free_cells))
    more = f"; {cut:,} more cells are cut off by them" if cut > 0 else ""
    return (
        f"discs: {len(grid.discs):,}, which close {closed:,} cells to planners and goals, among them about {free:,.1f} "
        f"of {closed * area:,.1f} m² that no disc covers{more}"
    )


def _round_area(grid: GridMap, cells: NDArray[np.bool_]) -> float:
    """Return how much [m²] of the cells discs cover, by samples."""
    where = np.argwhere(cells)
    inner = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    taken = np.zeros((len(where), _SAMPLES, _SAMPLES), np.bool_)
    index = np.full(grid.shape, -1, np.int64)
    index[tuple(where.T)] = np.arange(len(where))
    for disc in grid.discs.astype(np.float64):
        row, column = cells_near(disc, 0.0, grid.shape, grid.cell_size).T
        for k in index[grid.shape[0] - 1 - row, column]:
            if k >= 0:
                x, y = grid.centre(where[k]) - disc[:2]
                offset = inner * grid.cell_size
                taken[k] |= (x + offset[None]) ** 2 + (y + offset[:, None]) ** 2 < disc[2] ** 2
    return float(taken.mean(axis=(1, 2)).sum() * grid.cell_size**2) if len(where) else 0.0
