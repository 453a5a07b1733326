"""Default picks and stations for a map that names none."""

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.moves import beyond, label_regions

STATION_SPACING = 3  # [cells] between neighbouring stations: a 0.9 x 0.6 m robot stops at one and another passes


def largest_region(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return bool[H, W]: the largest connected region of the free cells (the first in reading order of equals)."""
    label = label_regions(free)
    sizes = np.bincount(label.ravel())
    sizes[0] = 0
    region: NDArray[np.bool_] = label == np.argmax(sizes)
    return region & free


def default_endpoints(occupied: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (picks int64[K, 2], stations int64[S, 2]) for a map that names none; both hold at least one cell.

    Stations lie along the west and east rim, `STATION_SPACING` apart, off the wall if there is room.
    Picks are the free cells orthogonally beside a shelf, or an even spread of the floor if there are no shelves.
    The two are disjoint unless the map has a single reachable cell.
    """
    region = largest_region(~occupied)
    stations = _rim_stations(region)
    rest = region.copy()
    rest[tuple(stations.T)] = False
    lattice = np.zeros_like(region)
    lattice[1::3, 1::3] = True
    for wanted in (beside(shelves(occupied)), beside(occupied), lattice, region):
        picks = np.argwhere(rest & wanted)
        if len(picks):
            return picks, stations
    return stations.copy(), stations


def _rim_stations(region: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return int64[S, 2]: in each row the cells nearest to the west and east rim, thinned out.

    Cells with room around them are preferred; a floor with fewer than two of these takes any.
    """
    cells = np.argwhere(region)
    roomy = region & beyond(region).all(axis=-1)  # a robot can turn there
    for mask in (roomy, region):
        stations = _thin_rims(mask)
        if len(stations) >= 2:
            break
    else:  # too small or odd for rims: the first and last cell
        ends = cells[[0, -1]].tolist()
        stations = [(ends[0][0], ends[0][1]), (ends[1][0], ends[1][1])][: min(2, len(cells))]
    if len(stations) >= len(cells) > 1:  # leave a cell for the picks
        stations = stations[:1]
    return np.array(sorted(stations), dtype=np.int64)


def _thin_rims(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the marked cells nearest to the west and the east rim, at least `STATION_SPACING` apart."""
    columns = mask.shape[1]
    band = max(1, columns // 3)  # further in than this is no rim
    accepted: list[tuple[int, int]] = []
    for west in (True, False):
        for row, line in enumerate(mask):
            marked = np.flatnonzero(line)
            if not len(marked):
                continue
            column = int(marked[0] if west else marked[-1])
            near = column < band if west else column >= columns - band
            apart = (max(abs(row - other[0]), abs(column - other[1])) for other in accepted)
            if near and all(cells >= STATION_SPACING for cells in apart):
                accepted.append((row, column))
    return accepted


def beside(occupied: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return bool[H, W]: cells with an occupied cell orthogonally beside them."""
    return np.asarray(beyond(occupied)[..., ::2].any(axis=-1))


def shelves(occupied: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return bool[H, W]: the occupied cells that are not part of a wall, i.e. not connected with the map's edge."""
    label = label_regions(occupied)
    edge = np.concatenate([label[0], label[-1], label[:, 0], label[:, -1]])
    result: NDArray[np.bool_] = occupied & ~np.isin(label, edge)
    return result
