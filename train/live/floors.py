"""The floors of a live world, and floors with shelves added or removed."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError, unknown_name
from warehouse_env.maps.endpoints import largest_region
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import LAYOUTS, make_layout


class LiveFloors:
    """The named layouts, and the first floor, which may be a file's."""

    def __init__(self, layout: str) -> None:
        """Read the first floor; ConfigError or MapError if there is none."""
        self.first = Path(layout).name
        self._given = make_layout(layout)
        self.names = list(dict.fromkeys([self.first, *LAYOUTS]))

    def load(self, name: str) -> GridMap:
        """Return a floor of `names`; pages cannot name files."""
        if name == self.first:
            return self._given
        if name not in self.names:
            raise unknown_name("floor", name, self.names)
        return make_layout(name)


def with_shelves(grid: GridMap, cells: Sequence[Sequence[int]], stand: bool, bare: GridMap) -> GridMap:
    """Return a floor with or without shelves on cells (row, column).

    bare: the first floor; its reachable picks and stations are kept. Raises ConfigError or MapError for cells off the
    floor, and if no pick or no station is left.
    """
    where = tuple(_on_floor(grid, cells).T)
    if (grid.occupied & ~grid.walls)[where].any():
        raise ConfigError("a disc stands there; discs stay where they are")
    occupied = grid.occupied.copy()
    occupied[where] = stand
    if occupied.all():
        raise ConfigError("the last free cell stays free")
    reached = largest_region(~occupied)
    picks, stations = (ends[reached[tuple(ends.T)]] for ends in (bare.picks, bare.stations))
    if not len(picks) or not len(stations):
        raise ConfigError(f"with shelves there, robots could reach no {'station' if len(picks) else 'pick face'}")
    one_way = np.where(occupied, 0, bare.one_way)
    # tight floor for the robots' bodies is found anew
    return dataclasses.replace(grid, occupied=occupied, one_way=one_way, picks=picks, stations=stations, tight=None)


def _on_floor(grid: GridMap, cells: Sequence[Sequence[int]]) -> NDArray[np.int64]:
    """Return cells as int64[K, 2]; ConfigError for one off the floor."""
    rows, columns = grid.shape
    for row, column in cells:
        if not (0 <= row < rows and 0 <= column < columns):
            raise ConfigError(f"there is no cell ({row}, {column}): rows are 0..{rows - 1}, columns 0..{columns - 1}")
    return np.array(cells, dtype=np.int64)


def free_cell(grid: GridMap, cell: Sequence[int]) -> Cell:
    """Return a cell for a person; ConfigError or MapError if it is off the floor, on or among shelves."""
    found = grid.check_cell(cell, "cell")
    if not (grid.free_cells == found).all(axis=1).any():
        raise ConfigError(f"cell {found} is shut in by shelves")
    return found
