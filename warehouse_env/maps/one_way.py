"""One-way cells: cells with a direction that planners keep.

A move of eq. 26 is against a cell's direction if it has a component opposite to it. Three of the eight moves are, and
may neither leave nor enter the cell; robots may cross it. As text, directions are one line a row, `.` for none and an
arrow otherwise; they lie in NAME.oneway beside NAME.map.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.errors import MapError
from warehouse_env.files import companion, read_text, write_text
from warehouse_env.maps.tables import numbers

ARROWS = ".>^<v"  # none, east, north, west, south: MOVES[2 * (k - 1)]
SUFFIX = ".oneway"
_LARGEST_FILE = 64_000_000  # [bytes]


def checked(one_way: ArrayLike | None, occupied: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return a C-ordered uint8[H, W] copy of indices into ARROWS, zeros if not given, or raise MapError."""
    if one_way is None:
        return np.zeros(occupied.shape, np.uint8)
    array = numbers(one_way, occupied.shape, "one_way", 0, len(ARROWS) - 1)
    wrong = (array % 1 > 0) | ((array > 0) & occupied)
    if wrong.any():
        row, column = np.argwhere(wrong)[0].tolist()
        raise MapError(
            f"one_way at cell ({row}, {column}) is {array[row, column]:g}; it must be 0 (none, as on shelves), "
            "1 (east), 2 (north), 3 (west) or 4 (south)"
        )
    return array.astype(np.uint8)


def against(one_way: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return bool[H, W, 8]: whether a move has a component opposite to the cell's direction."""
    move = np.arange(8)
    off = (move - 2 * (one_way[..., None].astype(np.int64) - 1)) % 8
    return (one_way[..., None] > 0) & (off >= 3) & (off <= 5)


def read(path: Path, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return the directions uint8[H, W] that a file holds for a floor of this shape; MapError if it is damaged."""
    text = read_text(path, "one-way file", _LARGEST_FILE)
    try:
        found = parse([line.strip() for line in text.rstrip().split("\n")])
        if found.shape != shape:
            raise MapError(f"it has {found.shape} rows and columns, the floor {shape}; remove it")
    except MapError as error:
        raise MapError(f"{path}: {error}") from None
    return found


def parse(lines: Sequence[str]) -> NDArray[np.uint8]:
    """Return uint8[H, W] of one line a row, in ARROWS; MapError for a row of another length or an unknown letter."""
    for number, line in enumerate(lines, start=1):
        if len(line) != len(lines[0]):
            raise MapError(f"line {number}: this row has {len(line)} cells, the first has {len(lines[0])}")
        for column, letter in enumerate(line, start=1):
            if letter not in ARROWS:
                raise MapError(
                    f"line {number}: unknown letter {letter!r} in column {column}; known: {' '.join(ARROWS)}"
                )
    return np.array([[ARROWS.index(letter) for letter in line] for line in lines], dtype=np.uint8)


def write_beside(path: Path, one_way: NDArray[np.uint8]) -> None:
    """Write the directions of a floor to NAME.oneway beside its map; without any, remove such a file."""
    beside = companion(path, SUFFIX)
    if one_way.any():
        write_text(beside, "\n".join(text(one_way)) + "\n")
    else:
        beside.unlink(missing_ok=True)


def text(one_way: NDArray[np.uint8]) -> list[str]:
    """Return one line a row, as `parse` reads them."""
    return ["".join(ARROWS[k] for k in row) for row in one_way.tolist()]
