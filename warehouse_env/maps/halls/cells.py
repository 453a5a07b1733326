"""From a map's pixels to cells, and what is lost on the way."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import RobotSpec
from warehouse_env.errors import MapError
from warehouse_env.maps.discs import cells_near
from warehouse_env.maps.generators import LARGEST
from warehouse_env.maps.halls.map_server import UNKNOWN, Occupancy
from warehouse_env.maps.halls.picture import MOST_PIXELS


@dataclass(frozen=True)
class Raster:
    """Cells over a plane: rows and columns of squares with a side [m], and the (x, y) [m] of the lower left corner."""

    rows: int
    columns: int
    cell: float
    origin: tuple[float, float]

    def cells(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return int64[..., 2], the cells (row, column) of points (x, y) [m]; off the floor they lie outside."""
        with np.errstate(invalid="ignore"):
            column = np.floor((points[..., 0] - self.origin[0]) / self.cell)
            row = self.rows - 1 - np.floor((points[..., 1] - self.origin[1]) / self.cell)
        cells: NDArray[np.int64] = np.clip(np.stack([row, column], axis=-1), -(2**40), 2**40).astype(np.int64)
        return cells

    def inside(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return bool[...]: which cells (row, column) there are."""
        return np.asarray(((cells >= 0) & (cells < (self.rows, self.columns))).all(axis=-1))

    def centres(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return float64[..., 2], the centres (x, y) [m] of cells (row, column)."""
        x = self.origin[0] + (cells[..., 1] + 0.5) * self.cell
        y = self.origin[1] + (self.rows - 1 - cells[..., 0] + 0.5) * self.cell
        return np.stack([x, y], axis=-1)


def raster_of(occupancy: Occupancy, cell: float) -> Raster:
    """Return the whole cells from a picture's upper left corner on; MapError where there is none, or too many."""
    rows, columns = (math.floor(n * occupancy.resolution / cell + 1e-6) for n in occupancy.values.shape)
    if min(rows, columns) < 1:
        raise MapError(f"the map is smaller than a cell of {cell:g} m; choose a smaller cell=")
    if max(rows, columns) > LARGEST:
        raise MapError(f"the map has more than {LARGEST} cells of {cell:g} m in a row; choose a larger cell=")
    x, y = occupancy.origin
    return Raster(rows, columns, cell, (x, y + occupancy.values.shape[0] * occupancy.resolution - rows * cell))


def spread(occupancy: Occupancy, weights: NDArray[np.float64], raster: Raster) -> NDArray[np.float64]:
    """Return float64[H, W], the mean weight of the pixels whose centres lie in each cell; 0 where there are none.

    weights: float64[h, w], of the pixels. Pixels wider than a cell count for each cell that they cover.
    """
    finer = max(1, math.ceil(occupancy.resolution / raster.cell - 1e-6))
    rows, columns = weights.shape
    if rows * columns * finer**2 > MOST_PIXELS:
        raise MapError(f"its pixels are {finer} cells wide; choose a larger cell=")
    if finer > 1:
        weights = weights.repeat(finer, axis=0).repeat(finer, axis=1)
    row, column = (_along(occupancy, raster, axis, finer) for axis in (0, 1))
    weights = weights[np.ix_(row >= 0, column >= 0)]
    row, column = row[row >= 0], column[column >= 0]
    index = (row[:, None] * raster.columns + column).ravel()
    size = raster.rows * raster.columns
    total, count = np.bincount(index, weights.ravel(), size), np.bincount(index, minlength=size)
    return (total / np.maximum(count, 1)).reshape(raster.rows, raster.columns)


def _along(occupancy: Occupancy, raster: Raster, axis: int, finer: int) -> NDArray[np.int64]:
    """Return int64[h or w], the row or column of cells of each row or column of pixels; -1 outside."""
    pixels, cells = occupancy.values.shape[axis] * finer, (raster.rows, raster.columns)[axis]
    size = occupancy.resolution / finer
    if axis == 0:
        shift = raster.origin[1] + cells * raster.cell - occupancy.origin[1] - pixels * size
    else:
        shift = occupancy.origin[0] - raster.origin[0]
    found = np.floor((shift + (np.arange(pixels) + 0.5) * size) / raster.cell + 1e-9).astype(np.int64)
    return np.where((found >= 0) & (found < cells), found, -1)


def not_free(values: NDArray[np.int8], unknown_free: bool) -> NDArray[np.float64]:
    """Return float64[h, w]: the share of each pixel that is not free."""
    return np.where(values == UNKNOWN, 0.0 if unknown_free else 1.0, values / 100.0)


def within(discs: NDArray[np.float64], occupancy: Occupancy) -> NDArray[np.bool_]:
    """Return bool[h, w]: the pixels that a disc (x, y, radius) [m] of float64[K, 3] meets, in the map's own frame."""
    found: NDArray[np.bool_] = np.zeros(occupancy.values.shape, np.bool_)
    shift, size = np.array([*occupancy.origin, 0.0]), occupancy.resolution
    for disc in discs - shift:
        row, column = cells_near(disc, 0.0, found.shape, size).T
        found[len(found) - 1 - row, column] = True
    return found


def closed(occupancy: Occupancy, floor: NDArray[np.bool_], raster: Raster, unknown_free: bool) -> NDArray[np.bool_]:
    """Return bool[H, W]: cells where a robot finds room in the map, but there is no floor beside them in any direction.

    Room is a free square as wide as a robot; single cells are left out: they are corners.
    """
    free = not_free(occupancy.values, unknown_free) == 0
    room = spread(occupancy, _square_fits(free, RobotSpec.width / occupancy.resolution), raster) > 0
    near = np.pad(floor, 1)
    rows, columns = floor.shape
    around = [near[a : a + rows, b : b + columns] for a in (0, 1, 2) for b in (0, 1, 2)]
    found = room & ~np.any(around, axis=0)
    padded = np.pad(found, 1)
    several = padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]
    return np.asarray(found & several)


def _square_fits(free: NDArray[np.bool_], side: float) -> NDArray[np.float64]:
    """Return float64[h, w]: 1 in the middle of each free square of that side [pixels], rounded up."""
    k = max(1, math.ceil(side - 1e-6))
    found = np.zeros(free.shape)
    if k <= min(free.shape):
        total = np.pad((~free).astype(np.int32), ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
        taken = total[k:, k:] - total[:-k, k:] - total[k:, :-k] + total[:-k, :-k]
        found[k // 2 : k // 2 + taken.shape[0], k // 2 : k // 2 + taken.shape[1]] = taken == 0
    return found
