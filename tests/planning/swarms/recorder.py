"""A stand-in for the decoding of codes, with a cost whose answer is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.ants.floor import make_floor
from warehouse_env.planning.swarms.waypoints import Code, Paths

TARGET = (2.0, 3.0)


class Recorder(Paths):
    """Notes the codes that are tried on a map of 11 x 11 cells; a code's cost is its distance from TARGET."""

    def __init__(self) -> None:
        grid = GridMap(np.zeros((11, 11), dtype=bool))
        super().__init__(grid, make_floor(grid, (10, 10)), 0)
        self.tried: list[Code] = []

    def cost(self, code: Code) -> NDArray[np.float64]:
        """Sum of the coordinates' distances from TARGET, over all points."""
        self.tried.append(code.copy())
        distance: NDArray[np.float64] = np.abs(code - TARGET).sum(axis=(1, 2))
        return distance
