"""Where the cells of a hall begin: anywhere within the first, by whole pixels, so that most of the hall is kept.

Cells that begin badly cut a strip off every aisle, and close those that are hardly wider than a cell. What counts is
the floor that robots drive on, what stands in it by the map, and aisles that close. Masks, discs and lanes do not
count: whoever edits one finds the cells where they were.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.endpoints import largest_region
from warehouse_env.maps.halls.cells import Sums, closed, exceeds, not_free, raster_of, room_of
from warehouse_env.maps.halls.map_server import Occupancy

_STANDS = 5  # times its area that what stands in a cell counts against it: cells keep off walls where there is floor
_CLOSED = 2  # cells of floor that a closed cell of an aisle is worth, besides its own: goods stand on both sides of it
_MOST_STEPS = 64  # along a cell's side; finer pixels are skipped


class Kept(NamedTuple):
    """What cells keep of a hall that begin somewhere [m], to the right of and below its picture's corner."""

    begin: tuple[float, float]
    worth: float  # [% of pixels], of what is kept
    driven: int  # cells of the largest region
    stands: float  # [cells], of what is not free in them
    closed: NDArray[np.bool_]  # [H, W], cells where an aisle closes


class Choice(NamedTuple):
    """What the best cells keep, and those that begin at the corner."""

    best: Kept
    corner: Kept


class _Judge:
    def __init__(self, occupancy: Occupancy, cell: float, share: float, unknown_free: bool) -> None:
        self._occupancy, self._cell, self._share = occupancy, cell, share
        self._taken = Sums(occupancy, not_free(occupancy.values, unknown_free), cell)
        self._room = Sums(occupancy, room_of(occupancy, unknown_free), cell)

    def kept(self, begin: tuple[float, float], least: float = -math.inf) -> Kept | None:
        """Return what cells keep that begin there; None if it is worth no more than the least."""
        raster = raster_of(self._occupancy, self._cell, begin)
        taken, count = self._taken.over(raster)
        floor = ~exceeds(taken / np.maximum(count, 1), self._share)
        gain = np.maximum(100 * count - _STANDS * taken, 0)  # so that all floor has no less than what is driven on
        if gain[floor].sum() <= least:  # whatever is cut off or closes; most end here
            return None
        driven = largest_region(floor)
        worth = float(gain[driven].sum())
        lost = closed(self._room.over(raster)[0] > 0, floor)
        worth -= _CLOSED * 100.0 * (self._cell / self._occupancy.resolution) ** 2 * int(lost.sum())
        stands = float((taken / np.maximum(100 * count, 1))[driven].sum())
        return Kept(begin, worth, int(driven.sum()), stands, lost) if worth > least else None


def choose(occupancy: Occupancy, cell: float, share: float, unknown_free: bool) -> Choice:
    """Return the cells that keep most of a hall; of equals those that begin nearest to the top, then to the left.

    So a map that was drawn in whole cells keeps them: begun elsewhere, they hold no more.
    """
    judge = _Judge(occupancy, cell, share, unknown_free)
    corner = judge.kept((0.0, 0.0))
    assert corner is not None
    best = corner
    height, width = occupancy.values.shape
    for down in _steps(height, occupancy.resolution, cell):
        for right in _steps(width, occupancy.resolution, cell):
            best = judge.kept((right, down), best.worth) or best
    return Choice(best, corner)


def _steps(pixels: int, resolution: float, cell: float) -> Iterator[float]:
    """Yield where cells may begin [m] along a side, so that one of them is whole."""
    wide = math.ceil(cell / resolution - 1e-6)
    for k in range(0, wide, math.ceil(wide / _MOST_STEPS)):
        if k * resolution <= pixels * resolution - cell * (1 - 1e-6):
            yield round(k * resolution, 9)
