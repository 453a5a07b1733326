"""The state of a search: nodes, their queue, and the table of cells of (x, y, heading, step)."""

from typing import Any, NamedTuple

import numpy as np

from warehouse_env.kernel import part
from warehouse_env.routes.reeds_shepp import WORDS

MOVES = 7  # forwards straight, left, right; backwards the same; wait
RATES = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 0.0])
SIDES = np.array([0.0, 1.0, -1.0, 0.0, 1.0, -1.0, 0.0])  # curvature over the tightest
TURN = np.pi / 6.0  # [rad] of a step on the tightest arc; a fine step is a half, a quarter, ... of it
_CELL, _HEADINGS = 0.27, 24  # side of a cell in turning radii, and headings, where steps are not fine
_SLOTS = 1 << 18
_BITS = 16  # of a column and a row in a key
X, Y, HEADING, TO_GO = range(4)  # columns of `nodes`
NONE = -1


class Tree(NamedTuple):
    """Arrays that every search of a planning writes into."""

    nodes: Any  # float64[M, 4]
    steps: Any  # int32[M] from the start
    met: Any  # int32[M] meetings so far
    parents: Any  # int32[M]
    moves: Any  # int8[M]
    keys: Any  # float64[M], the queue's
    queue: Any  # int32[M]
    cells: Any  # int64[_SLOTS], keys of cells
    stamps: Any  # int32[_SLOTS], the search that wrote one
    fewest: Any  # int32[_SLOTS], meetings on the way to the cell
    lengths: Any  # float64[WORDS] of the curves from a node


def make_tree(nodes: int) -> Tree:
    """Return the arrays for searches of up to this many nodes, no more than half of the table's places."""
    steps, met, parents, queue = np.empty((4, nodes), np.int32)
    return Tree(
        np.empty((nodes, 4)), steps, met, parents, np.empty(nodes, np.int8), np.empty(nodes), queue,
        np.empty(_SLOTS, np.int64), np.zeros(_SLOTS, np.int32), np.empty(_SLOTS, np.int32), np.empty(WORDS),
    )  # fmt: skip


@part
def place_of(x, y, heading, step, fine, radius, stamp, tree):
    """Return (place, key) of a cell in the table, whether it is there or not."""
    cell, headings = _CELL * radius / fine, fine * _HEADINGS
    column, row = int(np.floor(x / cell)), int(np.floor(y / cell))
    facing = int(np.floor(heading / (2.0 * np.pi) * headings + 0.5)) % headings
    key = (((np.int64(step) << _BITS) + column << _BITS) + row) * 256 + facing
    place = ((key * np.int64(0x9E3779B97F4A7C1)) >> 20 ^ key) & (_SLOTS - 1)
    while tree.stamps[place] == stamp and tree.cells[place] != key:
        place = (place + 1) & (_SLOTS - 1)
    return place, key


@part
def is_known(place, met, stamp, tree):
    """Return whether the cell at a place of the table has been reached with as few meetings."""
    return tree.stamps[place] == stamp and tree.fewest[place] <= met
