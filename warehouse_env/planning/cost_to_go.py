"""Exact cost-to-go fields, cached for goals that are asked for again.

Costs are whole thousandths of a cell, so sums do not depend on their order and equal costs are equal numbers. Live
replanning uses a field as the bound of its search and as the rest of the path beyond its horizon.
"""

from collections import OrderedDict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.heap import pop, push
from warehouse_env.kernel import inline, kernel
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.plan import MICRO, tolls

UNIT = 1000  # costs of a cell of way
DIAGONAL = 1414  # of a diagonal step
UNREACHABLE = np.iinfo(np.int32).max
MARGIN = 40  # [cells] by which a field extends beyond the rectangle of start and goal
_ROUNDED = 64  # [cells] to which its sides are rounded, so that one field serves many starts
_KEPT = 1_200_000_000  # bytes of fields


class Box(NamedTuple):
    """A rectangle of cells: rows from `top` to before `bottom`, columns from `left` to before `right`."""

    top: int
    left: int
    bottom: int
    right: int


@inline
def octile(rows, columns):
    """Return the cost of the shortest way over so many rows and columns where no shelf is in the way."""
    high, wide = abs(rows), abs(columns)
    return UNIT * max(high, wide) + (DIAGONAL - UNIT) * min(high, wide)


@kernel
def cost_field(steps, goal_row, goal_column, top, left, bottom, right):
    """Return the cost to the goal of the cheapest walk within a box, int32[bottom - top, right - left], or UNREACHABLE.

    steps: int32[H, W, 8], what the moves of eq. 26 (paper 000) cost; 0 for those not legal.
    """
    rows, columns = bottom - top, right - left
    cost = np.full(rows * columns, UNREACHABLE, np.int32)
    most = 8 * cost.size + 1  # each way into a cell is offered once
    keys, cells = np.empty(most, np.int32), np.empty(most, np.int32)
    goal = (goal_row - top) * columns + goal_column - left
    cost[goal] = 0
    size = push(keys, cells, 0, 0, goal)
    while size > 0:
        known, cell, size = pop(keys, cells, size)
        if known > cost[cell]:  # a cheaper way was found since
            continue
        row, column = cell // columns, cell % columns
        for move in range(8):  # by which one comes here
            r, c = row - MOVES[move, 0], column - MOVES[move, 1]
            if not (0 <= r < rows and 0 <= c < columns and steps[top + r, left + c, move] > 0):
                continue
            total = known + steps[top + r, left + c, move]
            other = r * columns + c
            if total < cost[other]:
                cost[other] = total
                size = push(keys, cells, size, total, other)
    return cost.reshape((rows, columns))


@inline
def to_go(field, top, left, row, column):
    """Return the cost-to-go of a cell, UNREACHABLE outside the field, whose first cell is (top, left)."""
    i, j = row - top, column - left
    if not (0 <= i < field.shape[0] and 0 <= j < field.shape[1]):
        return UNREACHABLE
    return int(field[i, j])


class CostToGo:
    """Fields of one floor, computed on demand and kept as long as there is room."""

    def __init__(self, grid: GridMap, gentleness: float = 0.0) -> None:
        """gentleness: cells of length that a metre of climbing is worth (PlanError from `tolls` where too much)."""
        steps = np.where(np.arange(8) % 2, DIAGONAL, UNIT) * grid.legal_moves
        toll = tolls(grid, gentleness)
        if toll is not None:
            steps += np.rint(toll * (UNIT / MICRO)).astype(np.int64)
        self.grid = grid
        self.steps = steps.astype(np.int32)  # [H, W, 8], what each move costs; 0 where it is not legal
        self._fields: OrderedDict[tuple[Cell, Box], NDArray[np.int32]] = OrderedDict()
        self._bytes = 0

    def box(self, start: Cell, goal: Cell) -> Box:
        """Return the box around a start and a goal in which to look for a path."""
        rows, columns = self.grid.shape

        def side(one: int, other: int, size: int) -> tuple[int, int]:
            low, high = min(one, other) - MARGIN, max(one, other) + MARGIN + 1
            return max(low // _ROUNDED * _ROUNDED, 0), min(-(-high // _ROUNDED) * _ROUNDED, size)

        (top, bottom), (left, right) = side(start[0], goal[0], rows), side(start[1], goal[1], columns)
        return Box(top, left, bottom, right)

    def whole(self) -> Box:
        """Return the whole floor."""
        return Box(0, 0, *self.grid.shape)

    def around(self, cell: Cell, goal: Cell) -> tuple[NDArray[np.int32], Box]:
        """Return the field of a goal in which a cell is far from the edge, and its box."""
        box = self.box(cell, goal)
        field = self.field(goal, box)
        if field[cell[0] - box.top, cell[1] - box.left] == UNREACHABLE:
            box = self.whole()
        return self.field(goal, box), box

    def field(self, goal: Cell, box: Box) -> NDArray[np.int32]:
        """Return int32[h, w], the cost-to-go [thousandths of a cell] to a goal within a box; UNREACHABLE where none."""
        key = goal, box
        found = self._fields.get(key)
        if found is None:
            found = cost_field(self.steps, *goal, *box)
            self._fields[key] = found
            self._bytes += found.nbytes
            while self._bytes > _KEPT and len(self._fields) > 1:
                self._bytes -= self._fields.popitem(last=False)[1].nbytes
        else:
            self._fields.move_to_end(key)
        return found
