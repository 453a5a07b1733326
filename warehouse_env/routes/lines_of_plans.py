"""Many routes at a time from a floor's plan table: a GPU's worlds want a quarter of a million at their first reset."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel
from warehouse_env.routes.lanes import drivable_line
from warehouse_env.routes.route_table import BEHIND

_USUAL = 64  # way-points of a route, about


class Plans(NamedTuple):
    """A PlanTable as kernels see it."""

    numbers: NDArray[np.int64]  # [H, W], of the endpoints; elsewhere -1
    begins: NDArray[np.int64]  # [E * E + 1]
    moves: NDArray[np.uint8]
    steps: NDArray[np.int64]  # [M, 2], what a move means


@kernel
def _centres(start, moves, steps, rows, cell):
    """Return the centres of a plan's cells, float64[L, 2] [m]; start: its first (row, column)."""
    points, (row, column) = np.empty((len(moves) + 1, 2)), start
    for k in range(len(moves) + 1):
        if k > 0:
            row, column = row + steps[moves[k - 1], 0], column + steps[moves[k - 1], 1]
        points[k, 0], points[k, 1] = (column + 0.5) * cell, (rows - 1 - row + 0.5) * cell
    return points


@kernel
def drivable_lines(keys, plans, solid, one_way, cell, keep_right, wider):
    """Make the lines of some routes by their keys int64[K]; see `drivable_line` for the rest.

    Returns the number of way-points of each, int64[K], 0 for one that is not planned or must not begin with a turn, and
    all way-points one after another, float32[P, 2] [m].
    """
    (rows, columns), count = plans.numbers.shape, int(np.sqrt(len(plans.begins) - 1.0))
    counts, points, used = np.zeros(len(keys), np.int64), np.empty((_USUAL * len(keys), 2), np.float32), 0
    for k in range(len(keys)):
        path, behind = divmod(keys[k] - 1, len(BEHIND))
        start, goal = divmod(path, rows * columns)
        at = start // columns, start % columns
        first, last = plans.numbers[at], plans.numbers[goal // columns, goal % columns]
        if behind != 0 or first < 0 or last < 0:
            continue
        plan = last * count + first
        moves = plans.moves[plans.begins[plan] : plans.begins[plan + 1]]
        if len(moves) == 0:
            continue
        line = drivable_line(
            _centres(at, moves, plans.steps, rows, cell), solid, one_way, cell, keep_right, np.inf, wider
        )
        if used + len(line) > len(points):
            larger = np.empty((2 * len(points) + len(line), 2), np.float32)
            larger[:used] = points[:used]
            points = larger
        points[used : used + len(line)] = line
        counts[k], used = len(line), used + len(line)
    return counts, points[:used]
