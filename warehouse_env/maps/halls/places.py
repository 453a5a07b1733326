"""Picks and stations of a hall: proposed, and kept in a small file that a person edits.

NAME.places.json beside the map: {"picks": [{"id": 1, "x": 3.5, "y": 2.5}, ...], "stations": [...]}, in metres of the
map's own frame, so it is valid for any size of cells.
"""

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import MapError, shown
from warehouse_env.files import as_number, read_json, write_text
from warehouse_env.maps.endpoints import beside, default_endpoints, largest_region, shelves
from warehouse_env.maps.halls.cells import Raster, exceeds, spread
from warehouse_env.maps.halls.map_server import Occupancy
from warehouse_env.maps.moves import beyond

SUFFIX = ".places.json"
KINDS = ("picks", "stations")
_LARGEST_FILE = 16_000_000  # [bytes]
MOST = 100_000


class Place(NamedTuple):
    """A pick face or a station: its name and position in the map's frame [m]."""

    name: str
    x: float
    y: float


Places = dict[str, tuple[Place, ...]]
"""Kind, of KINDS -> places; a missing kind is proposed."""


def read_places(path: Path) -> Places:
    """Return the places in a file; MapError in one sentence, naming the damaged place."""
    data = read_json(path, "places file", _LARGEST_FILE)
    if not isinstance(data, dict) or not data.keys() & set(KINDS):
        raise MapError(f'{path} must hold "picks" and "stations", each a list of places')
    found: Places = {}
    for kind in KINDS:
        if kind in data:
            found[kind] = _listed(path, kind, data[kind])
    return found


def _listed(path: Path, kind: str, entries: Any) -> tuple[Place, ...]:
    if not isinstance(entries, list) or not 1 <= len(entries) <= MOST:
        raise MapError(f'{path}: "{kind}" must be a list of 1 to {MOST:,} places like {{"id": 1, "x": 3.5, "y": 2.5}}')
    places: dict[str, Place] = {}
    for number, entry in enumerate(entries, start=1):
        name = str(entry.get("id", number))[:80] if isinstance(entry, dict) else str(number)
        where = [as_number(entry.get(axis)) if isinstance(entry, dict) else math.nan for axis in "xy"]
        if not all(map(math.isfinite, where)):
            raise MapError(f"{path}: {kind[:-1]} {shown(name)} must have numbers x and y, in metres")
        if name in places:
            raise MapError(f"{path}: {kind} names {shown(name)} twice; give each its own id")
        places[name] = Place(name, *where)
    return tuple(places.values())


def write_places(places: Places, path: Path) -> None:
    """Write a file of places, one a line, for a person to edit."""
    kinds = []
    for kind, listed in places.items():
        lines = [f'    {{"id": {json.dumps(place.name)}, "x": {place.x:g}, "y": {place.y:g}}}' for place in listed]
        kinds.append(f'  "{kind}": [\n' + ",\n".join(lines) + "\n  ]")
    write_text(path, "{\n" + ",\n".join(kinds) + "\n}\n")


def places_at(points: NDArray[np.float64], names: Iterable[str] | None = None) -> tuple[Place, ...]:
    """Return points (x, y) [m] of the map's frame as places, numbered from 1 if they have no names."""
    named = map(str, range(1, len(points) + 1)) if names is None else names
    return tuple(Place(name, x, y) for name, (x, y) in zip(named, points.round(6).tolist(), strict=True))


def cells_of(
    places: tuple[Place, ...], kind: str, floor: NDArray[np.bool_], raster: Raster
) -> tuple[NDArray[np.int64], list[str], list[str]]:
    """Return int64[K, 2], the nearest cell of floor to each place, each once; their names; and notes on the others.

    A place farther than a cell from any floor is left out; MapError if none is left.
    """
    names: dict[tuple[int, int], str] = {}
    lost, same = [], 0
    for place in places:
        cell = _nearest(np.array([place.x, place.y]), floor, raster)
        if cell is None:
            lost.append(place)
        elif cell in names:
            same += 1
        else:
            names[cell] = place.name
    notes = []
    if lost:
        first = lost[0]
        notes.append(
            f"{len(lost)} of {len(places)} {kind} are on no floor that robots reach and are left out, the first is "
            f"{shown(first.name)} at ({first.x:g}, {first.y:g}) m"
        )
    if same:
        notes.append(f"{same} of {len(places)} {kind} share a cell with another and count once")
    if not names:
        raise MapError(f"none of the {len(places)} {kind} is on floor that robots reach; {notes[0]}")
    return np.array(list(names), dtype=np.int64), list(names.values()), notes


def _nearest(point: NDArray[np.float64], floor: NDArray[np.bool_], raster: Raster) -> tuple[int, int] | None:
    """Return the cell of floor that contains a point [m], or that cell's nearest neighbour; None without either."""
    row, column = raster.cells(point).tolist()
    around = np.array([(row + a, column + b) for a in (0, -1, 1) for b in (0, -1, 1)], dtype=np.int64)
    around = around[raster.inside(around)]
    around = around[floor[tuple(around.T)]]
    if not len(around):
        return None
    if tuple(around[0].tolist()) == (row, column):
        return row, column
    row, column = around[np.argmin(((raster.centres(around) - point) ** 2).sum(axis=1))].tolist()
    return row, column


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
