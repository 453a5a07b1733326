"""Many routes at a time, without Python: a GPU's worlds want a quarter of a million at their first reset."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, kernel
from warehouse_env.maps.grid_map import MOVES
from warehouse_env.maps.standing import centre_of
from warehouse_env.planning.graph_search import find_path
from warehouse_env.routes.lanes import drivable_line
from warehouse_env.routes.route_table import BEHIND

_USUAL = 64  # way-points of a route, about


class Plans(NamedTuple):
    """How to plan on a floor: a PlanTable as kernels see it, and the moves for a search where it has no plan."""

    numbers: NDArray[np.int64]  # [H, W], of the endpoints; elsewhere -1
    begins: NDArray[np.int64]  # [E * E + 1]
    moves: NDArray[np.uint8]
    legal: NDArray[np.bool_]  # [H, W, 8]
    searches: bool  # the planner is `astar_turns`; else there is only the table


@inline
def _block(legal, row, column):
    """Close a cell to all moves."""
    for m in range(8):
        y, x = row - MOVES[m, 0], column - MOVES[m, 1]
        if 0 <= y < legal.shape[0] and 0 <= x < legal.shape[1]:
            legal[y, x, m] = False
            if m % 2 == 0:  # diagonals past the cell
                legal[y, x, m + 1] = legal[y, x, (m - 1) % 8] = False


@kernel
def known_plan(start, goal, plans):
    """Return the cells of the table's plan, int64[L], without any if there is none."""
    columns, count = plans.numbers.shape[1], int(np.sqrt(len(plans.begins) - 1.0))
    first = plans.numbers[start // columns, start % columns]
    last = plans.numbers[goal // columns, goal % columns]
    if first < 0 or last < 0:
        return np.empty(0, np.int64)
    begin, end = plans.begins[last * count + first], plans.begins[last * count + first + 1]
    cells = np.empty(end - begin + 1 if end > begin else 0, np.int64)
    for k in range(len(cells)):
        move = plans.moves[begin + k - 1]
        cells[k] = start if k == 0 else cells[k - 1] + MOVES[move, 0] * columns + MOVES[move, 1]
    return cells


@kernel
def _cells(start, goal, behind, plans):
    """Return the cells of a route, int64[L], without any if none is found; behind: of BEHIND."""
    columns = plans.numbers.shape[1]
    if behind != 0:
        if not plans.searches:
            return np.empty(0, np.int64)
        legal = plans.legal.copy()
        _block(legal, start // columns + BEHIND[behind][0], start % columns + BEHIND[behind][1])
        cells = find_path(legal, None, start, goal, True, True)
        if len(cells) > 0:
            return cells
    cells = known_plan(start, goal, plans)  # behind: a dead end, out of which it must back
    if len(cells) == 0 and plans.searches:
        cells = find_path(plans.legal.copy(), None, start, goal, True, True)  # of the type of `legal` above
    return cells


@kernel
def drivable_lines(keys, plans, solid, one_way, cell, keep_right, wider):
    """Make the lines of some routes by their keys int64[K]; see `drivable_line` for the rest.

    Returns the number of way-points of each, int64[K], 0 for one that is not planned, and all way-points one after
    another, float32[P, 2] [m].
    """
    rows, columns = plans.numbers.shape
    counts, points, used = np.zeros(len(keys), np.int64), np.empty((_USUAL * len(keys), 2), np.float32), 0
    for k in range(len(keys)):
        path, behind = divmod(keys[k] - 1, len(BEHIND))
        start, goal = divmod(path, rows * columns)
        cells = _cells(start, goal, behind, plans)
        if len(cells) == 0:
            continue
        centres = np.empty((len(cells), 2))
        for n in range(len(cells)):
            centres[n, 0], centres[n, 1] = centre_of(cells[n] // columns, cells[n] % columns, rows, cell)
        line = drivable_line(centres, solid, one_way, cell, keep_right, wider, np.inf)
        if used + len(line) > len(points):
            larger = np.empty((2 * len(points) + len(line), 2), np.float32)
            larger[:used] = points[:used]
            points = larger
        for n in range(len(line)):
            points[used + n, 0], points[used + n, 1] = line[n, 0], line[n, 1]
        counts[k], used = len(line), used + len(line)
    return counts, points[:used]
