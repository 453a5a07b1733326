"""Choose where the cells of a hall begin, by whole pixels, so that most of the hall is kept.

A bad choice cuts a strip off every aisle and closes aisles that are hardly wider than a cell. What counts is the floor
that robots drive on, obstacles in it, and closed aisles. Masks, discs and lanes do not count, so editing them does not
move the cells.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from warehouse_env.maps.endpoints import largest_region
from warehouse_env.maps.halls.cells import Sums, closed, exceeds, not_free, raster_of, room_of
from warehouse_env.maps.halls.map_server import Occupancy

_STANDS = 5  # weight of an obstacle's area in a cell against floor, so that cells keep off walls
_CLOSED = 2  # cells of floor that a closed aisle cell costs besides its own: goods lie on both sides of it
_MOST_STEPS = 64  # along a cell's side; finer pixels are skipped


def choose(occupancy: Occupancy, cell: float, share: float, unknown_free: bool) -> tuple[float, float]:
    """Return where the cells that keep most of a hall begin [m], to the right of and below the picture's corner.

    Ties go to the topmost, then the leftmost, so a map drawn in whole cells keeps its cells.
    """
    taken = Sums(occupancy, not_free(occupancy.values, unknown_free), cell)
    room = Sums(occupancy, room_of(occupancy, unknown_free), cell)
    aisle = _CLOSED * 100.0 * (cell / occupancy.resolution) ** 2

    def worth(begin: tuple[float, float], least: float) -> float:
        """Return what cells that begin there keep [% of pixels], or any number up to `least`."""
        raster = raster_of(occupancy, cell, begin)
        here, count = taken.over(raster)
        floor = ~exceeds(here / np.maximum(count, 1), share)
        gain = np.maximum(100 * count - _STANDS * here, 0)  # so that all floor is worth no less than its region
        if gain[floor].sum() <= least:  # even if nothing is cut off or closed; most end here
            return least
        lost = closed(room.over(raster)[0] > 0, floor)
        return float(gain[largest_region(floor)].sum() - aisle * int(lost.sum()))

    best, most = (0.0, 0.0), worth((0.0, 0.0), -math.inf)
    height, width = occupancy.values.shape
    for down in _steps(height, occupancy.resolution, cell):
        for right in _steps(width, occupancy.resolution, cell):
            found = worth((right, down), most)
            if found > most:
                best, most = (right, down), found
    return best


def _steps(pixels: int, resolution: float, cell: float) -> Iterator[float]:
    """Yield where cells may begin [m] along a side so that at least one is whole."""
    wide = math.ceil(cell / resolution - 1e-6)
    for k in range(0, wide, math.ceil(wide / _MOST_STEPS)):
        if k * resolution <= pixels * resolution - cell * (1 - 1e-6):
            yield round(k * resolution, 9)
