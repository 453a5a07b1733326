"""Any-angle search: shortest lines that need not follow the 8 directions of the lattice."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from warehouse_env.heap import pop, push
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.base import BasePlanner
from warehouse_env.planning.graph_search import find_path, unflatten
from warehouse_env.planning.plan import CostMap, Plan


@kernel
def line_of_sight(occupied, one_way, row, col, to_row, to_col):
    """Whether the straight line between the centres of two cells is free. occupied: bool[H, W].

    Every cell whose inside the line crosses must be free. Where it runs exactly through a corner, the two cells beside
    it must be free as well: eq. 26 (paper 000) for lines of any angle. Nor may the line have a component against the
    direction of a cell that it crosses (one_way: uint8[H, W], GridMap).
    """
    d_row, d_col = abs(to_row - row), abs(to_col - col)
    step_row, step_col = (1 if to_row > row else -1), (1 if to_col > col else -1)
    against_rows, against_columns = (2 if to_row > row else 4), (3 if to_col > col else 1)  # indices into ARROWS
    against = (against_rows if to_row != row else 0), (against_columns if to_col != col else 0)
    if one_way[row, col] > 0 and one_way[row, col] in against:
        return False
    ahead = d_col - d_row  # > 0: the next side the line crosses is a vertical one, < 0: horizontal, 0: a corner
    while row != to_row or col != to_col:
        if ahead == 0 and (occupied[row + step_row, col] or occupied[row, col + step_col]):
            return False
        vertical, horizontal = ahead >= 0, ahead <= 0
        if vertical:
            col += step_col
            ahead -= 2 * d_row
        if horizontal:
            row += step_row
            ahead += 2 * d_col
        if occupied[row, col] or (one_way[row, col] > 0 and one_way[row, col] in against):
            return False
    return True


@kernel
def _straight(cols, cell, other):
    """Distance [cells] between the centres of two flat cells."""
    d_row, d_col = cell // cols - other // cols, cell % cols - other % cols
    return math.sqrt(float(d_row * d_row + d_col * d_col))


@kernel
def _search(legal, occupied, one_way, start, goal):
    """Return the vertex (flat cell) before each cell on an any-angle path, -1 where none; the start's is itself.

    legal: bool[H, W, 8]. A cell's path goes to it straight from the vertex of the cell it was reached from, if that
    sees it ("path 2" of the paper), else by way of that cell ("path 1").
    """
    rows, cols = occupied.shape
    cells = rows * cols
    length = np.full(cells, np.inf)
    vertex = np.full(cells, -1, np.int64)
    closed = np.zeros(cells, np.bool_)
    keys, ties, items = np.empty(8 * cells + 1), np.empty(8 * cells + 1), np.empty(8 * cells + 1, np.int64)
    length[start] = 0.0
    vertex[start] = start
    size = push(keys, items, 0, 0.0, start, ties, 0.0)
    while size > 0:
        _, cell, size = pop(keys, items, size, ties)
        if cell == goal:
            break
        if closed[cell]:
            continue
        closed[cell] = True
        row, col = cell // cols, cell % cols
        for move in range(8):
            to_row, to_col = row + MOVES[move, 0], col + MOVES[move, 1]
            to = to_row * cols + to_col
            if not legal[row, col, move] or closed[to]:
                continue
            via = vertex[cell]
            if not line_of_sight(occupied, one_way, via // cols, via % cols, to_row, to_col):
                via = cell
            new_length = length[via] + _straight(cols, via, to)
            if new_length < length[to]:
                length[to], vertex[to] = new_length, via
                left = _straight(cols, to, goal)
                size = push(keys, items, size, new_length + left, to, ties, left)
    return vertex


@kernel
def _band(legal, line):
    """Return bool[H, W, 8], the legal moves between cells on or next to the line int64[K, 2] of cells."""
    rows, cols = legal.shape[0], legal.shape[1]
    near = np.zeros((rows, cols), np.bool_)
    for k in range(max(1, len(line) - 1)):
        row, col = line[k]
        d_row, d_col = line[min(k + 1, len(line) - 1)] - line[k]
        parts = max(abs(d_row), abs(d_col), 1)
        for part in range(parts + 1):  # where the line crosses the middle of a column or, if steep, of a row
            r = row + (2 * d_row * part + parts) // (2 * parts)
            c = col + (2 * d_col * part + parts) // (2 * parts)
            near[max(0, r - 1) : r + 2, max(0, c - 1) : c + 2] = True
    inside = np.zeros_like(legal)
    for row in range(rows):
        for col in range(cols):
            for move in range(8):
                if near[row, col] and legal[row, col, move]:
                    inside[row, col, move] = near[row + MOVES[move, 0], col + MOVES[move, 1]]
    return inside


@dataclass(frozen=True)
class ThetaStar(BasePlanner):
    """Basic Theta* (Nash, Daniel, Koenig & Felner 2007): a short path whose corners are cells, at any angle.

    `Plan.line` holds its vertices. It is close to the shortest such line, but in clutter seldom the shortest, since a
    cell takes over only the vertices that its neighbours have. Sight is taken from cell centre to cell centre and
    respects eq. 26 of paper 000: a line may neither enter a shelf nor touch its corner, as robots have a body. A tie
    goes to the cell nearer the goal.

    `Plan.cells` follows the line on the lattice: a shortest path by legal moves through the cells that the line
    crosses and their neighbours, with the fewest turns among these. It can be a little longer than the shortest path
    on the lattice, where the shortest line runs another way round a shelf.
    """

    name: ClassVar[str] = "theta_star"
    takes_cost: ClassVar[bool] = False  # the cost of a line at any angle would have to be integrated along it

    def find(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator, cost: CostMap) -> Plan:
        """Search; `rng` is not used."""
        cols = grid.shape[1]
        first, last = start[0] * cols + start[1], goal[0] * cols + goal[1]
        vertex = _search(grid.legal_moves, grid.closed, grid.one_way, first, last)
        if vertex[last] < 0:
            return Plan(np.empty((0, 2), np.int64))
        flat = [last]
        while flat[-1] != first:
            flat.append(int(vertex[flat[-1]]))
        line = unflatten(np.array(flat[::-1]), cols)
        followed = find_path(_band(grid.legal_moves, line), None, first, last, True, True)
        return Plan(unflatten(followed, cols), line=line.astype(np.float64))
