"""Who gets which order: a registry of rules, from what each robot would have to drive to each order's first pick."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import unknown_name


class Allocator(Protocol):
    """A rule that gives free robots open orders."""

    def __call__(self, cost: NDArray[np.float64]) -> list[tuple[int, int]]:
        """Return pairs (robot, order) in which nobody comes twice; as many as there are robots or orders.

        cost float[F, K] [cells]: from each free robot to each open order, oldest first. Ties go to the lower number.
        """
        ...


def fifo(cost: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Give the oldest order to the robot nearest to it, then the next."""
    left, pairs = cost.copy(), []
    for order in range(min(cost.shape)):
        robot = int(left[:, order].argmin())
        left[robot] = np.inf
        pairs.append((robot, order))
    return pairs


def nearest(cost: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pair the robot and the order that are nearest to each other, then the next of those left."""
    left, pairs = cost.copy(), []
    for _ in range(min(cost.shape)):
        robot, order = divmod(int(left.argmin()), cost.shape[1])
        left[robot], left[:, order] = np.inf, np.inf
        pairs.append((robot, order))
    return pairs


def optimal(cost: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pair robots and orders so that the sum of all costs is least.

    By shortest augmenting paths with potentials (the Hungarian method: Kuhn 1955, Jonker and Volgenant 1987), O(F F K).
    Own code: scipy, which has it, would be new in the core for this alone; tests hold it against scipy's.
    """
    if cost.shape[0] > cost.shape[1]:
        return sorted((robot, order) for order, robot in optimal(cost.T))
    rows, columns = cost.shape
    row_price, column_price = np.zeros(rows), np.zeros(columns)
    row_of = np.full(columns, -1)
    for row in range(rows):
        least, came_from = np.full(columns, np.inf), np.full(columns, -1)
        done = np.zeros(columns, dtype=np.bool_)
        at, column, length = row, -1, 0.0
        while True:  # Dijkstra over reduced costs, until a column without a row
            reach = length + cost[at] - row_price[at] - column_price
            better = ~done & (reach < least)
            least[better], came_from[better] = reach[better], column
            column = int(np.where(done, np.inf, least).argmin())
            length, done[column] = float(least[column]), True
            if row_of[column] < 0:
                break
            at = int(row_of[column])
        settled = np.flatnonzero(done & (row_of >= 0))
        row_price[row_of[settled]] += length - least[settled]
        column_price[settled] -= length - least[settled]
        row_price[row] += length
        while column >= 0:  # along the path, each column takes the row of the one before it
            before = int(came_from[column])
            row_of[column] = row if before < 0 else row_of[before]
            column = before
    return sorted((int(row), column) for column, row in enumerate(row_of) if row >= 0)


ALLOCATORS: dict[str, Allocator] = {"nearest": nearest, "fifo": fifo, "optimal": optimal}


def make_allocator(name: str) -> Allocator:
    """Return a rule by its name; ConfigError, with near matches, for an unknown one."""
    if name not in ALLOCATORS:
        raise unknown_name("allocation", name, ALLOCATORS)
    return ALLOCATORS[name]
