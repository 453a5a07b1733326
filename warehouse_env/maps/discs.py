"""Discs: round obstacles such as pillars, exact for bodies, sweeps and lidar.

Planners, lanes and goals see cells: a cell that a disc reaches into is occupied for them. NAME.discs.json beside a map
holds them in metres of the map's own frame, as {"discs": [{"x": 3.5, "y": 2.5, "radius": 0.3}, ...]}.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.errors import MapError, shown
from warehouse_env.files import as_number, companion, read_json, write_text
from warehouse_env.maps.tables import flags

SUFFIX = ".discs.json"
MOST = 100_000
SMALLEST, LARGEST = 1e-3, 1000.0  # [m] of a radius
_LARGEST_FILE = 16_000_000  # [bytes]
_EXAMPLE = '{"discs": [{"x": 3.5, "y": 2.5, "radius": 0.3}]}'


def checked(discs: ArrayLike | None, shape: tuple[int, ...], cell: float) -> NDArray[np.float32]:
    """Return a C-ordered float32[K, 3] copy of discs (x, y, radius) [m], empty if not given; MapError."""
    if discs is None:
        return np.zeros((0, 3), np.float32)
    try:
        array = np.array(discs, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(1)
    if array.shape == (0,):
        array = array.reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3 or len(array) > MOST:
        raise MapError(f"discs must be a list of at most {MOST:,} discs, each three numbers: x, y and radius [m]")
    high = np.array([shape[1] * cell, shape[0] * cell, LARGEST])
    fine = (array >= (0.0, 0.0, SMALLEST)) & (array <= high)
    if not fine.all():
        k = int(np.argmin(fine.all(axis=1)))
        raise MapError(
            f"disc {k} {shown(tuple(array[k].tolist()))} must have its centre on the floor of {high[0]:g} x {high[1]:g}"
            f" m and a radius from {SMALLEST} to {LARGEST:g} m"
        )
    return np.ascontiguousarray(array.astype(np.float32))


def cells_near(
    disc: NDArray[np.floating[Any]], margin: float, shape: tuple[int, ...], cell: float
) -> NDArray[np.int64]:
    """Return int64[M, 2], the (row, column) of cells nearer than `margin` [m] to a disc; row 0 is the southernmost.

    Cells off the floor of `shape` are left out.
    """
    x, y, radius = (float(value) for value in disc)
    reach = radius + margin
    rows, columns = (
        np.arange(max(math.floor((at - reach) / cell), 0), min(math.floor((at + reach) / cell) + 1, count))
        for at, count in ((y, shape[0]), (x, shape[1]))
    )
    dx = np.maximum(np.maximum(columns * cell - x, x - (columns + 1) * cell), 0.0)
    dy = np.maximum(np.maximum(rows * cell - y, y - (rows + 1) * cell), 0.0)
    near = np.argwhere(dx[None, :] ** 2 + dy[:, None] ** 2 < reach * reach)
    return np.stack([rows[near[:, 0]], columns[near[:, 1]]], axis=-1)


def covered(discs: NDArray[np.floating[Any]], shape: tuple[int, ...], cell: float) -> NDArray[np.bool_]:
    """Return bool[H, W]: the cells into which a disc reaches; row 0 is the north edge."""
    found = np.zeros(shape, np.bool_)
    for disc in discs:
        row, column = cells_near(disc, 0.0, shape, cell).T
        found[shape[0] - 1 - row, column] = True
    return found


def among(
    occupied: NDArray[np.bool_], walls: ArrayLike | None, discs: NDArray[np.float32], cell: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return (cells that are whole shelves, cells that shelves or discs occupy), each bool[H, W]; MapError.

    walls: which of the occupied cells that discs reach into are shelves (None: all); other occupied cells always are.
    """
    if not len(discs):
        return occupied, occupied
    reached = covered(discs, occupied.shape, cell)
    whole = occupied
    if walls is not None:
        whole = occupied & (flags(walls, occupied.shape, "walls") | ~reached)
    if (occupied | reached).all():
        raise MapError("the discs leave no free cell; a robot needs at least one")
    return whole, occupied | reached


def read_discs(path: Path) -> NDArray[np.float64]:
    """Return float64[K, 3], the discs (x, y, radius) [m] of a file in its own frame; MapError."""
    data = read_json(path, "discs file", _LARGEST_FILE)
    rows = data.get("discs") if isinstance(data, dict) else None
    if not isinstance(rows, list):
        raise MapError(f'{path} must hold "discs", a list like {_EXAMPLE}')
    if len(rows) > MOST:
        raise MapError(f"{path} holds {len(rows):,} discs; at most {MOST:,} are read")
    found = np.zeros((len(rows), 3))
    for k, row in enumerate(rows):
        numbers = [as_number(row.get(key)) for key in ("x", "y", "radius")] if isinstance(row, dict) else [math.nan]
        if not all(map(math.isfinite, numbers)) or not SMALLEST <= numbers[2] <= LARGEST:
            allowed = f"the radius from {SMALLEST} to {LARGEST:g}"
            raise MapError(f"{path}: disc {k + 1} {shown(row)} must have numbers x, y and radius in metres, {allowed}")
        found[k] = numbers
    return found


def write_beside(path: Path, discs: NDArray[np.floating[Any]]) -> None:
    """Write discs (x, y, radius) [m] to NAME.discs.json beside a map, one a line; without any, remove such a file."""
    beside = companion(path, SUFFIX)
    if not len(discs):
        beside.unlink(missing_ok=True)
        return
    numbers = [[float(str(value)) for value in disc] for disc in discs]  # the shortest decimals
    lines = [f'  {{"x": {x!r}, "y": {y!r}, "radius": {radius!r}}}' for x, y, radius in numbers]
    write_text(beside, '{"discs": [\n' + ",\n".join(lines) + "\n]}\n")
