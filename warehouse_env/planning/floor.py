"""A map and a task as flat arrays for the colony's kernels.

Cells are flat indices row * columns + column, an edge is (cell, move), and a path is its moves from the start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap

Table = NDArray[np.float64]  # [C, 8]: one number an edge

MICROMETRES = 1e6  # heights are counted in whole micrometres, so that sums of them are exact


class Floor(NamedTuple):
    """A map and a task as the kernels want them, C = H * W cells."""

    legal: NDArray[np.bool_]  # [C, 8], may the move be made (eq. 26)
    neighbour: NDArray[np.int32]  # [C, 8], the cell that a move leads to; the cell itself if it is not legal
    height: NDArray[np.int64]  # [C] micrometres
    start: int
    goal: int
    columns: int

    @property
    def flat(self) -> bool:
        """True where all cells are equally high."""
        return bool((self.height == self.height[0]).all())


def make_floor(grid: GridMap, start: Cell, goal: Cell) -> Floor:
    """Prepare a map and a task for the colony."""
    rows, cols = grid.occupied.shape
    step = MOVES[:, 0] * cols + MOVES[:, 1]
    cell = np.arange(rows * cols)[:, None]
    legal = grid.legal_moves.reshape(-1, 8)
    return Floor(
        legal,
        np.where(legal, cell + step, cell).astype(np.int32),
        np.rint(grid.height.astype(np.float64).ravel() * MICROMETRES).astype(np.int64),
        start[0] * cols + start[1],
        goal[0] * cols + goal[1],
        cols,
    )
