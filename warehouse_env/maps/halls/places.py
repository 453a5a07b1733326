"""Picks and stations of a hall: proposed, and kept in a small file that a person edits.

NAME.places.json beside the map: {"picks": [{"id": 1, "x": 3.5, "y": 2.5}, ...], "stations": [...]}, in metres of the
map's own frame, so it is valid for any size of cells.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import MapError, shown
from warehouse_env.files import as_number, read_json, write_text
from warehouse_env.maps.halls.cells import Raster

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


def places_at(raster: Raster, cells: NDArray[np.int64], names: Iterable[str] | None = None) -> tuple[Place, ...]:
    """Return cells (row, column) as places, numbered from 1 if they have no names."""
    points = np.round(raster.centres(cells), 6).tolist()
    named = map(str, range(1, len(points) + 1)) if names is None else names
    return tuple(Place(name, x, y) for name, (x, y) in zip(named, points, strict=True))


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
