"""A map and a goal as flat arrays for the colony's kernels; the ants' paths, their measures, and their pheromone.

Cells are flat indices row * columns + column, an edge is (cell, move), and a path is its moves from the start.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.plan import MICRO, tolls

Table = NDArray[np.float64]  # [C, 8]: one number an edge

_MAPS_KEPT = 8  # whose terrain is remembered


class AntFloor(NamedTuple):
    """A map and a goal as flat arrays, C = H * W cells."""

    legal: NDArray[np.bool_]  # [C, 8], may the move be made (eq. 26)
    neighbour: NDArray[np.int32]  # [C, 8], the cell that a move leads to; the cell itself if it is not legal
    height: NDArray[np.int64]  # [C] micrometres
    toll: NDArray[np.int64]  # [C, 8] millionths of a cell of length that a move costs on top of its own
    goal: int
    columns: int

    @property
    def flat(self) -> bool:
        """True where all cells are equally high."""
        return bool((self.height == self.height[0]).all())


def make_floor(grid: GridMap, goal: Cell, gentleness: float = 0.0, cost: NDArray[np.float64] | None = None) -> AntFloor:
    """Prepare a map and a goal for the colony.

    gentleness: cells of length that a metre of climbing costs; cost: a cost map (Planner.plan).
    """
    legal, neighbour, height = _terrain(grid)
    taken = tolls(grid, gentleness, cost)
    toll = np.zeros(neighbour.shape, np.int64) if taken is None else taken.reshape(-1, 8)
    return AntFloor(legal, neighbour, height, toll, goal[0] * grid.shape[1] + goal[1], grid.shape[1])


@lru_cache(maxsize=_MAPS_KEPT)
def _terrain(grid: GridMap) -> tuple[NDArray[np.bool_], NDArray[np.int32], NDArray[np.int64]]:
    """Return the parts of an AntFloor that do not depend on the task: legal moves, neighbours and heights."""
    rows, cols = grid.shape
    step = MOVES[:, 0] * cols + MOVES[:, 1]
    cell = np.arange(rows * cols)[:, None]
    legal = grid.legal_moves.reshape(-1, 8)
    neighbour = np.where(legal, cell + step, cell).astype(np.int32)
    height = np.rint(grid.height.astype(np.float64).ravel() * MICRO).astype(np.int64)
    return legal, neighbour, height


_SQRT2 = math.sqrt(2.0)


class Walks(NamedTuple):
    """The paths of some ants, one a row; the loop's buffers are overwritten by the next iteration."""

    start: NDArray[np.int64]  # [m] cell
    moves: NDArray[np.int8]  # [m, C], valid up to steps
    steps: NDArray[np.int64]  # [m], -1 for an ant that did not arrive
    length: NDArray[np.float64]  # [m] cells
    turns: NDArray[np.int64]  # [m] direction changes
    spread: NDArray[np.float64]  # [m] metres, standard deviation of the path's heights (eq. 24, paper 000)
    cost: NDArray[np.float64]  # [m] cells, length + tolls: what "best" means


def empty_walks(start: int, ants: int, cells: int) -> Walks:
    """Return room for the paths of ants from the cell `start` on a floor of `cells` cells; none has arrived yet."""
    return Walks(
        np.full(ants, start, np.int64), np.zeros((ants, cells), np.int8), np.full(ants, -1, np.int64),
        np.full(ants, np.inf), np.zeros(ants, np.int64), np.full(ants, np.inf), np.full(ants, np.inf),
    )  # fmt: skip


@kernel
def measure(floor, walks, first, last):
    """Fill length, turns, spread and cost of ants first..last-1; return the best by (cost, turns), -1 if none."""
    for ant in range(first, last):
        count = walks.steps[ant]
        if count < 0:
            walks.length[ant] = walks.cost[ant] = walks.spread[ant] = np.inf
            walks.turns[ant] = 0
            continue
        diagonal, turned, tolls, climbed, cell, heading = 0, 0, 0, 0, walks.start[ant], -1
        height_sum = floor.height[cell]
        for step in range(count):
            move = walks.moves[ant, step]
            to = floor.neighbour[cell, move]
            diagonal += move % 2
            if step > 0 and move != heading:
                turned += 1
            tolls += floor.toll[cell, move]
            climbed += abs(floor.height[to] - floor.height[cell])
            height_sum += floor.height[to]
            heading, cell = move, to
        walks.length[ant] = (count - diagonal) + diagonal * _SQRT2
        walks.turns[ant] = turned
        walks.cost[ant] = walks.length[ant] + tolls / MICRO
        walks.spread[ant] = 0.0 if climbed == 0 else _spread(floor, walks, ant, height_sum / (count + 1))
    return next_best(walks, first, last, -1.0, 0)


@kernel
def next_best(walks, first, last, cost, turns):
    """Return the first of ants first..last-1 with the least (cost, turns) above those given; -1 if there is none."""
    best = -1
    for ant in range(first, last):
        if walks.steps[ant] < 0 or walks.cost[ant] < cost or (walks.cost[ant] == cost and walks.turns[ant] <= turns):
            continue
        better = best < 0 or walks.cost[ant] < walks.cost[best]
        if better or (walks.cost[ant] == walks.cost[best] and walks.turns[ant] < walks.turns[best]):
            best = ant
    return best


@kernel
def _spread(floor, walks, ant, mean):
    """Standard deviation [m] of the heights along a path with p - 1 steps (eq. 24, paper 000)."""
    cell, count = walks.start[ant], walks.steps[ant]
    deviation = floor.height[cell] - mean
    total = deviation * deviation
    for step in range(count):
        cell = floor.neighbour[cell, walks.moves[ant, step]]
        deviation = floor.height[cell] - mean
        total += deviation * deviation
    return math.sqrt(total / count) / MICRO


@kernel
def deposit(floor, pheromone, walks, amount):
    """Add amount float64[k] of the first k ants, where they arrived, to every edge of their paths, in place."""
    for ant in range(len(amount)):
        cell = walks.start[ant]
        for step in range(walks.steps[ant]):
            move = walks.moves[ant, step]
            pheromone[cell, move] += amount[ant]
            cell = floor.neighbour[cell, move]


def keep(walks: Walks, ant: int, best: Walks) -> None:
    """Copy the path of an ant and its measures to `best`, which has room for one."""
    for name in Walks._fields:
        getattr(best, name)[0] = getattr(walks, name)[ant]
