"""Propose picks and stations in a hall without any: beside straight obstacles, and along the rim."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.endpoints import beside, default_endpoints, largest_region, shelves
from warehouse_env.maps.halls.cells import Raster, exceeds, spread
from warehouse_env.maps.halls.map_server import Occupancy
from warehouse_env.maps.moves import beyond

RACK = 1.0  # [m] least length: pillars and clutter are shorter
FACE = 1.2  # [m] least straight face for goods: a pallet's length
_SOLID = 50  # [%] occupied, above which a pixel belongs to an obstacle


def propose(
    occupied: NDArray[np.bool_], goods: NDArray[np.bool_], walls: NDArray[np.bool_], cell: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return picks int64[K, 2] and stations int64[S, 2] of a bare map.

    Picks are floor beside straight obstacles, of the first of these kinds that has any: goods, free-standing walls, any
    walls, any closed cell. If there are others, no pick lies where a standing robot would cut floor off (well-formed
    infrastructures: Cap et al. 2015) or in a dead end. Stations lie along the west and east rim of the floor that
    robots drive on. Maps too small or odd for this get `default_endpoints`.

    occupied, goods, walls: bool[H, W], cells that are no floor, cells with part of a rack (`racks`), and cells with an
    obstacle; cell: their side [m].
    """
    from warehouse_env.maps.distance import cut_cells

    region = largest_region(~occupied)
    rows, columns = (np.flatnonzero(region.any(axis=axis)) for axis in (1, 0))
    part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    usual, stations = default_endpoints(~region[part])
    corner = np.array([rows[0], columns[0]])
    usual, stations = usual + corner, stations + corner
    free = region.copy()
    free[tuple(stations.T)] = False
    long = max(2, math.ceil(FACE / cell - 1e-6))
    bars = cut_cells(region) | region & (beyond(region)[..., ::2].sum(axis=-1) < 2)  # and dead ends
    for obstacles in (goods, shelves(walls), walls, occupied):
        found = free & _beside_straight(obstacles, region, long) & beside(obstacles)
        for faces in (found & ~bars, found):
            if faces.any():
                return np.argwhere(faces), stations
    return usual, stations


def racks(
    occupancy: Occupancy, weights: NDArray[np.int64], raster: Raster, walls: NDArray[np.bool_], share: float
) -> NDArray[np.bool_]:
    """Return bool[H, W]: the cells of `walls` with more than `share` of a rack in them.

    A rack is a connected set of pixels at least RACK long, with floor that robots drive on beyond it on all four sides.
    Pixels, not cells, because racks close to a wall or to each other touch as cells. weights: int[h, w], how much of
    each pixel is not free [%].
    """
    from scipy import ndimage  # imported late: it takes long

    label, _ = ndimage.label(weights > _SOLID)
    boxes = np.array([[(side.start, side.stop) for side in box] for box in ndimage.find_objects(label)])
    boxes = boxes.reshape(-1, 2, 2)  # region, row and column, first and past the last
    size = occupancy.resolution
    long = (boxes[..., 1] - boxes[..., 0]).max(axis=1) * size >= RACK - 1e-6
    row, column = (np.flatnonzero(largest_region(~walls).any(axis=axis)) for axis in (1, 0))
    top = label.shape[0] * size + occupancy.origin[1] - raster.origin[1] - raster.rows * raster.cell
    left = raster.origin[0] - occupancy.origin[0]
    first = np.array([top + row[0] * raster.cell, left + column[0] * raster.cell])  # of the floor [m], from the corner
    last = np.array([top + (row[-1] + 1) * raster.cell, left + (column[-1] + 1) * raster.cell])
    among = (boxes[..., 0] * size > first).all(axis=1) & (boxes[..., 1] * size < last).all(axis=1)
    kept = np.concatenate([[False], long & among])[label]
    return np.asarray(walls & exceeds(spread(occupancy, 100 * kept.astype(np.int64), raster), share))


def _beside_straight(obstacles: NDArray[np.bool_], floor: NDArray[np.bool_], long: int) -> NDArray[np.bool_]:
    """Return bool[H, W]: floor in a row of at least `long` cells with obstacles on the same side."""
    from scipy import ndimage

    found = np.zeros_like(floor)
    for turns in range(4):
        near, free = np.rot90(obstacles, turns), np.rot90(floor, turns)
        face = np.zeros_like(free)
        face[1:] = free[1:] & near[:-1]
        found |= np.rot90(ndimage.binary_opening(face, np.ones((1, long))), -turns)
    return found
