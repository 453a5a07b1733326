"""GridMap: shelves, floor heights and endpoints on a grid; the only place that converts metres and cells."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import MapError

Cell = tuple[int, int]

# The 8 moves of eq. 26 (paper 000) as (d_row, d_col), counter-clockwise from east; odd indices are diagonal.
MOVES: NDArray[np.int64] = np.array(
    [(0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1)], dtype=np.int64
)


@dataclass(frozen=True, eq=False)
class GridMap:
    """A warehouse floor.

    occupied: bool[H, W], True where a shelf stands; row 0 is the north edge.
    height: float32[H, W], floor height [m].
    picks, stations: int64[K, 2], endpoint cells (row, col) of lifelong tasks.
    cell_size: side of a cell [m].
    """

    occupied: NDArray[np.bool_]
    height: NDArray[np.float32] = field(default=None)  # type: ignore[assignment]
    cell_size: float = 1.0
    picks: NDArray[np.int64] = field(default=None)  # type: ignore[assignment]
    stations: NDArray[np.int64] = field(default=None)  # type: ignore[assignment]
    name: str = "unnamed"

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.occupied.shape  # type: ignore[return-value]
