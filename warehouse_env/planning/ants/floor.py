"""A map and a goal as flat arrays for the colony's kernels.

Cells are flat indices row * columns + column, an edge is (cell, move), and a path is its moves from the start.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.plan import MICRO, tolls

Table = NDArray[np.float64]  # [C, 8]: one number an edge

_MAPS_KEPT = 8  # whose terrain is remembered


class AntFloor(NamedTuple):
    """A map and a goal as flat arrays, C = H * W cells."""

    legal: NDArray[np.bool_]  # [C, 8], may the move be made (eq. 26)
    neighbour: NDArray[np.int32]  # [C, 8], the cell that a move leads to; the cell itself if it is not legal
    height: NDArray[np.int64]  # [C] micrometres
    toll: NDArray[np.int64]  # [C, 8] millionths of a cell of length that a move costs on top of its own
    goal: int
    columns: int

    @property
    def flat(self) -> bool:
        """True where all cells are equally high."""
        return bool((self.height == self.height[0]).all())


def make_floor(grid: GridMap, goal: Cell, gentleness: float = 0.0, cost: NDArray[np.float64] | None = None) -> AntFloor:
    """Prepare a map and a goal for the colony.

    gentleness: cells of length that a metre of climbing costs; cost: a cost map (Planner.plan).
    """
    legal, neighbour, height = _terrain(grid)
    taken = tolls(grid, gentleness, cost)
    toll = np.zeros(neighbour.shape, np.int64) if taken is None else taken.reshape(-1, 8)
    return AntFloor(legal, neighbour, height, toll, goal[0] * grid.shape[1] + goal[1], grid.shape[1])


@lru_cache(maxsize=_MAPS_KEPT)
def _terrain(grid: GridMap) -> tuple[NDArray[np.bool_], NDArray[np.int32], NDArray[np.int64]]:
    """Return the parts of an AntFloor that do not depend on the task: legal moves, neighbours and heights."""
    rows, cols = grid.shape
    step = MOVES[:, 0] * cols + MOVES[:, 1]
    cell = np.arange(rows * cols)[:, None]
    legal = grid.legal_moves.reshape(-1, 8)
    neighbour = np.where(legal, cell + step, cell).astype(np.int32)
    height = np.rint(grid.height.astype(np.float64).ravel() * MICRO).astype(np.int64)
    return legal, neighbour, height
