"""Dijkstra, A* and turn-aware A* on the moves of eq. 26 (paper 000): the exact reference for the other planners.

A cost is kept as two whole numbers: diagonal steps, and millionths of a cell for straight steps and tolls. It is
computed from them once, so equal costs are equal numbers whatever the order of steps and tolls (sqrt(2) is irrational).
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import PlanError
from warehouse_env.heap import pop, push
from warehouse_env.kernel import inline, kernel, whole
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.base import BasePlanner
from warehouse_env.planning.plan import MICRO, CostMap, Plan, check_endpoints, tolls, turns

_SQRT2 = math.sqrt(2.0)
_STEP = int(MICRO)  # millionths of a cell: a straight step
START = whole(8)  # in place of the arriving move: the start


@kernel
def _labels(states, start):
    """Labels of a search, [states]: straight (with tolls), diagonal, length, turns, state before, closed; and a heap.

    A state is pushed at most once for each of the 8 moves that enter its cell. The heap's arrays come last: otherwise
    malloc returns pages after every search, and a short search takes twice as long.
    """
    straight, diagonal, length = np.zeros(states, np.int64), np.zeros(states, np.int64), np.full(states, np.inf)
    length[start] = 0.0
    turned, before, closed = np.zeros(states, np.int64), np.full(states, -1, np.int64), np.zeros(states, np.bool_)
    heap = np.empty(8 * states + 1), np.empty(8 * states + 1), np.empty(8 * states + 1, np.int64)  # keys, ties, items
    return straight, diagonal, length, turned, before, closed, heap


@inline
def _ahead(d_row, d_col):
    """Straight and diagonal steps over so many rows and columns where no shelf is in the way."""
    diagonal = min(abs(d_row), abs(d_col))
    return max(abs(d_row), abs(d_col)) - diagonal, diagonal


@inline
def is_hairpin(arrived, move):
    """Whether a move after another is a turn of more than 90 degrees."""
    return arrived != START and 3 <= (move - arrived) % 8 <= 5


@kernel
def _search(legal, toll, start, goal, informed, turning):
    """Return the state before each on a cheapest path, -1 where none, and the goal's state, -1 without a path.

    A state is a cell (flat index); if `turning`, it is 9 * cell + arriving move, START at the start, and the cost is
    (length + tolls, turns). legal: bool[H, W, 8]; toll: int64[H, W, 8], millionths of a cell that a move costs more
    than its length, or None. informed: A* with the octile distance; otherwise Dijkstra. Ties go to the state of fewer
    turns, or to the cell nearer the goal.
    """
    rows, cols = legal.shape[0], legal.shape[1]
    states = 9 if turning else 1  # of a cell
    first = 9 * start + START if turning else start
    straight, diagonal, length, turned, before, closed, (keys, ties, items) = _labels(states * rows * cols, first)
    goal_row, goal_col = goal // cols, goal % cols
    size = push(keys, items, 0, 0.0, first, ties, 0.0)
    while size > 0:
        _, state, size = pop(keys, items, size, ties)
        cell, arrived = state // states, state % states
        if cell == goal:
            return before, state
        if closed[state]:
            continue
        closed[state] = True
        row, col = cell // cols, cell % cols
        for move in range(8):
            if not legal[row, col, move]:
                continue
            to_row, to_col = row + MOVES[move, 0], col + MOVES[move, 1]
            to = states * (to_row * cols + to_col) + (move if turning else 0)
            a = straight[state] + (1 - move % 2) * _STEP
            if toll is not None:
                a += toll[row, col, move]
            b = diagonal[state] + move % 2
            new_turns = turned[state] + (1 if turning and arrived != START and arrived != move else 0)
            new_length = a / MICRO + b * _SQRT2
            if new_length < length[to] or (new_length == length[to] and new_turns < turned[to]):
                length[to], straight[to], diagonal[to], turned[to], before[to] = new_length, a, b, new_turns, state
                ahead_a, ahead_b = _ahead(to_row - goal_row, to_col - goal_col) if informed else (0, 0)
                estimate = (a + ahead_a * _STEP) / MICRO + (b + ahead_b) * _SQRT2
                tie = float(new_turns) if turning else ahead_a + ahead_b * _SQRT2
                size = push(keys, items, size, estimate, to, ties, tie)
    return before, -1


@kernel
def find_path(legal, toll, start, goal, informed, turning):
    """Return the flat cells of a cheapest path, int64[L], empty where there is none; arguments: see `_search`."""
    before, last = _search(legal, toll, start, goal, informed, turning)
    count, state = 0, last
    while state >= 0:
        count, state = count + 1, before[state]
    path, state = np.empty(count, np.int64), last
    for k in range(count - 1, -1, -1):
        path[k], state = state // (9 if turning else 1), before[state]
    return path


def unflatten(flat: NDArray[np.int64], columns: int) -> NDArray[np.int64]:
    """Return flat cells as int64[L, 2] (row, col)."""
    return np.stack(np.divmod(flat, columns), axis=1)


@dataclass(frozen=True)
class _GraphSearch(BasePlanner):
    """Base of the exact searches. They draw no random numbers."""

    gentleness: float = 0.0  # [cells/m] detour that a metre of climbing is worth

    takes_cost: ClassVar[bool] = True
    informed: ClassVar[bool] = True  # by the octile distance
    turning: ClassVar[bool] = False  # whether turns count

    def find(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator, cost: CostMap) -> Plan:
        """Search on flat cells."""
        columns = grid.shape[1]
        toll = tolls(grid, self.gentleness, cost)
        first, last = start[0] * columns + start[1], goal[0] * columns + goal[1]
        flat = find_path(grid.legal_moves, toll, first, last, self.informed, self.turning)
        return Plan(unflatten(flat, columns))


@dataclass(frozen=True)
class Dijkstra(_GraphSearch):
    """Shortest path without a heuristic (Dijkstra 1959)."""

    name: ClassVar[str] = "dijkstra"
    informed: ClassVar[bool] = False


@dataclass(frozen=True)
class AStar(_GraphSearch):
    """Shortest path with the octile distance as heuristic (Hart, Nilsson & Raphael 1968)."""

    name: ClassVar[str] = "astar"


@dataclass(frozen=True)
class AStarTurns(_GraphSearch):
    """The fewest turns among the shortest paths: A* on cell x direction with the cost (length, turns)."""

    name: ClassVar[str] = "astar_turns"
    turning: ClassVar[bool] = True


def min_turns(grid: GridMap, start: Cell, goal: Cell) -> int:
    """Fewest direction changes that a shortest path from start to goal can have; PlanError if there is no path."""
    start, goal = check_endpoints(grid, start, goal)
    first, last = start[0] * grid.shape[1] + start[1], goal[0] * grid.shape[1] + goal[1]
    flat = find_path(grid.legal_moves, None, first, last, True, True)
    if not len(flat):
        raise PlanError(f"no path from {start} to {goal}")
    return turns(unflatten(flat, grid.shape[1]))
