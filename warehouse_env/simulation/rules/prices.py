"""What the other robots of a world cost a live route: a cost map made of where they stand and of where they are going.

What is priced, and why: live.py. Prices are sums in float64, said where a kernel would widen a float32 by itself, for
plain Python would not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from warehouse_env.kernel import inline, kernel
from warehouse_env.maps.grid_map import MOVES
from warehouse_env.simulation.rules.waits import DEARER, bars_routes


class Prices(NamedTuple):
    """What others cost, in cells of way, but for `crowd_within`. They were chosen together: docs/measured/trials.md."""

    standing: float = 10.0  # for entering the cell of a robot that stands
    beside: float = 3.0  # for entering a cell beside it
    against: float = 1.0  # for a move against one of another's remaining route
    boxed_against: float = 8.0  # so in an aisle of one cell, where two cannot pass
    crowd: float = 0.6  # for entering a cell of another's remaining route that both are equally far from
    crowd_within: float = 10.0  # [m] difference of these distances at which that has faded to nothing
    turn: float = 1.0  # for beginning with a turn of 90 degrees, twice that for turning round
    boxed_turn: float = 30.0  # for beginning with a turn of more than 90 degrees in an aisle of one cell


PRICES = Prices()
_DIAGONAL = math.sqrt(2.0) - 1.0


@inline
def cell_of(x, y, cell, rows, columns):
    """Return (row, column) of the cell that holds a point [m], on the floor."""
    row = rows - 1 - int(math.floor(y / cell))
    return min(max(row, 0), rows - 1), min(max(int(math.floor(x / cell)), 0), columns - 1)


@inline
def body_cell(r, behind, cell, rows, columns):
    """Return (row, column) of the cell that holds the centre of a body, `behind` [m] the front axle."""
    return cell_of(r["x"] - behind * r["cos"], r["y"] - behind * r["sin"], cell, rows, columns)


@kernel
def _charge_entry(cost, row, column, price):
    """Add a price to all moves that enter a cell, if it is on the floor. cost: float64[H, W, 8]."""
    rows, columns = cost.shape[0], cost.shape[1]
    if not (0 <= row < rows and 0 <= column < columns):
        return
    for move in range(8):
        i, j = row - MOVES[move, 0], column - MOVES[move, 1]
        if 0 <= i < rows and 0 <= j < columns:
            cost[i, j, move] += price


@inline
def ahead_of(r):
    """Return the number of the first point of a robot's route that is ahead of it."""
    return int(r["position"] / max(r["spacing"], np.float32(1e-6))) + 1


@inline
def way(rows, columns):
    """Return the length [cells] of the shortest way over so many rows and columns without shelves."""
    high, wide = abs(rows), abs(columns)
    return max(high, wide) + _DIAGONAL * min(high, wide)


@inline
def _is_boxed(legal, row, column, move):
    """Whether one who makes this move from a cell, or the opposite one, could leave it to neither side."""
    return not (legal[row, column, (move + 2) % 8] or legal[row, column, (move + 6) % 8])


@kernel
def _charge_route(cost, r, route, row, column, legal, against, boxed_against, crowd, crowd_within, cell):
    """Add the prices of what is left of a robot's route, for one in the cell (row, column).

    Each move against it costs, `boxed_against` where the two could not pass, half as much the moves beside that.
    Entering a cell of it costs `crowd` if both are as far from there, and nothing from `crowd_within` [m] more or less.
    """
    rows, columns = cost.shape[0], cost.shape[1]
    first, spacing, size = ahead_of(r), np.float64(r["spacing"]), np.float64(cell)
    before_row, before_column = cell_of(r["x"], r["y"], cell, rows, columns)
    for k in range(first, r["points"]):
        i, j = cell_of(route[k, 0], route[k, 1], cell, rows, columns)
        if i == before_row and j == before_column:
            continue
        back = _eighth(before_row - i, before_column - j)
        dear = boxed_against if _is_boxed(legal, i, j, back) else against
        cost[i, j, back] += dear
        cost[i, j, (back + 1) % 8] += 0.5 * dear
        cost[i, j, (back + 7) % 8] += 0.5 * dear
        apart = abs(way(i - row, j - column) * size - (k - first + 1) * spacing)
        if apart < crowd_within:
            _charge_entry(cost, i, j, crowd * (1.0 - apart / crowd_within))
        before_row, before_column = i, j


@kernel
def _eighth(d_row, d_column):
    """Return the index of the move of MOVES that is nearest to a direction in rows and columns."""
    return int(round(math.atan2(-d_row, d_column) / (0.25 * math.pi))) % 8


@kernel
def _charge_turns(cost, r, row, column, legal, turn, boxed_turn):
    """Add the prices of turning away from a robot's heading to the moves that leave its cell."""
    ahead = int(round(np.float64(r["heading"]) / (0.25 * math.pi))) % 8
    boxed = _is_boxed(legal, row, column, ahead)
    for move in range(8):
        off = (move - ahead) % 8
        off = min(off, 8 - off)
        cost[row, column, move] += turn * (0.0, 0.2, 1.0, 2.0, 2.0)[off]
        if boxed and off > 2:
            cost[row, column, move] += boxed_turn


@kernel
def price(robots, routes, me, legal, stood_for, prices, behind, cell, cost):
    """Write the cost map float64[H, W, 8] [cells] that the others of a world make for robot `me`.

    robots: ROBOT[N]; routes: float32[N, R, 2] [m]; legal: bool[H, W, 8]; prices: Prices; behind [m]: a body's
    centre, behind its front axle.
    """
    standing, beside, against, boxed_against, crowd, crowd_within, turn, boxed_turn = prices
    rows, columns = cost.shape[0], cost.shape[1]
    cost[:] = 0.0
    row, column = cell_of(robots[me]["x"], robots[me]["y"], cell, rows, columns)
    dearer = 1.0 + np.float64(robots[me]["standing_time"]) / DEARER
    for other in range(robots.shape[0]):
        r = robots[other]
        if other == me:
            continue
        if bars_routes(r, stood_for):
            at_row, at_column = body_cell(r, behind, cell, rows, columns)
            for i in range(at_row - 1, at_row + 2):
                for j in range(at_column - 1, at_column + 2):
                    _charge_entry(cost, i, j, dearer * (standing if i == at_row and j == at_column else beside))
        if r["alive"] != 0:
            _charge_route(cost, r, routes[other], row, column, legal, against, boxed_against, crowd, crowd_within, cell)
    _charge_turns(cost, robots[me], row, column, legal, turn, boxed_turn)


@kernel
def cells_ahead(r, route, cell, rows, columns):
    """Return the cells int64[L, 2] from where a robot is along what is left of its route."""
    cells = np.empty((r["points"] + 1, 2), np.int64)
    cells[0, 0], cells[0, 1] = cell_of(r["x"], r["y"], cell, rows, columns)
    count = 1
    for k in range(ahead_of(r), r["points"]):
        i, j = cell_of(route[k, 0], route[k, 1], cell, rows, columns)
        if i != cells[count - 1, 0] or j != cells[count - 1, 1]:
            cells[count, 0], cells[count, 1] = i, j
            count += 1
    return cells[:count]


@kernel
def path_cost(cells, cost):
    """Return length and prices [cells] of a path of cells int64[L, 2]; one that skips cells pays where it leaves."""
    total = 0.0
    for k in range(len(cells) - 1):
        d_row, d_column = cells[k + 1, 0] - cells[k, 0], cells[k + 1, 1] - cells[k, 1]
        total += way(d_row, d_column) + cost[cells[k, 0], cells[k, 1], _eighth(d_row, d_column)]
    return total
