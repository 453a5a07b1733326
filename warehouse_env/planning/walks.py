"""What the ants of one iteration did: their paths, the measures of these, and the pheromone they leave."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from warehouse_env.planning.floor import MICROMETRES, Floor, Table

_SQRT2 = math.sqrt(2.0)


class Walks(NamedTuple):
    """The paths of one iteration's m ants; the buffers of the loop, overwritten by the next iteration."""

    moves: NDArray[np.int8]  # [m, C], valid up to steps
    steps: NDArray[np.int64]  # [m], -1 for an ant that did not arrive
    length: NDArray[np.float64]  # [m] cells
    turns: NDArray[np.int64]  # [m] direction changes
    spread: NDArray[np.float64]  # [m] metres, standard deviation of the path's heights (eq. 24, paper 000)
    cost: NDArray[np.float64]  # [m] cells, length + gentleness * metres climbed: what "best" means


def empty_walks(ants: int, cells: int) -> Walks:
    """Room for the paths of `ants` ants on a floor of `cells` cells; no ant has arrived yet."""
    return Walks(
        np.zeros((ants, cells), np.int8),
        np.full(ants, -1, np.int64),
        np.full(ants, np.inf),
        np.zeros(ants, np.int64),
        np.full(ants, np.inf),
        np.full(ants, np.inf),
    )


@njit(cache=True, error_model="numpy")
def measure(floor: Floor, gentleness: float, walks: Walks, first: int, last: int) -> int:
    """Fill length, turns, spread and cost of ants first..last-1; return the best of them by (cost, turns), -1 if none.

    gentleness: cells per metre climbed.
    """
    best = -1
    for ant in range(first, last):
        count = walks.steps[ant]
        if count < 0:
            walks.length[ant] = walks.cost[ant] = np.inf
            walks.turns[ant] = 0
            walks.spread[ant] = np.inf
            continue
        diagonal, turned, climbed, cell, heading = 0, 0, 0, floor.start, -1
        height_sum = floor.height[cell]
        for step in range(count):
            move = walks.moves[ant, step]
            to = floor.neighbour[cell, move]
            diagonal += move % 2
            if step > 0 and move != heading:
                turned += 1
            climbed += abs(floor.height[to] - floor.height[cell])
            height_sum += floor.height[to]
            heading, cell = move, to
        walks.length[ant] = (count - diagonal) + diagonal * _SQRT2
        walks.turns[ant] = turned
        walks.cost[ant] = walks.length[ant] + gentleness * climbed / MICROMETRES
        walks.spread[ant] = 0.0 if climbed == 0 else _spread(floor, walks.moves[ant], count, height_sum / (count + 1))
        better = best < 0 or walks.cost[ant] < walks.cost[best]
        if better or (walks.cost[ant] == walks.cost[best] and walks.turns[ant] < walks.turns[best]):
            best = ant
    return best


@njit(cache=True, error_model="numpy")
def _spread(floor: Floor, moves: NDArray[np.int8], count: int, mean: float) -> float:
    """Standard deviation [m] of the heights along a path with p - 1 = count steps (eq. 24, paper 000)."""
    cell = floor.start
    deviation = floor.height[cell] - mean
    total = deviation * deviation
    for step in range(count):
        cell = floor.neighbour[cell, moves[step]]
        deviation = floor.height[cell] - mean
        total += deviation * deviation
    return math.sqrt(total / count) / MICROMETRES


@njit(cache=True)
def deposit(floor: Floor, pheromone: Table, walks: Walks, amount: NDArray[np.float64]) -> None:
    """Add amount float64[m] of each arrived ant to every edge of its path, in place."""
    for ant in range(len(amount)):
        cell = floor.start
        for step in range(walks.steps[ant]):
            move = walks.moves[ant, step]
            pheromone[cell, move] += amount[ant]
            cell = floor.neighbour[cell, move]
