"""Rules that assign orders to robots, by the distance from each robot to each order's first pick face."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import unknown_name

Allocator = Callable[[NDArray[np.float64]], list[tuple[int, int]]]
"""A rule: from costs float[F, K] [cells] of each free robot to each open order, oldest first, to pairs (robot, order).

It pairs each robot and order at most once, and as many as possible. Ties go to the lower number.
"""


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
    """Pair robots and orders so that the sum of all costs is least (the Hungarian method)."""
    from scipy.optimize import linear_sum_assignment

    return [(int(robot), int(order)) for robot, order in zip(*linear_sum_assignment(cost), strict=True)]


ALLOCATORS: dict[str, Allocator] = {"nearest": nearest, "fifo": fifo, "optimal": optimal}


def make_allocator(name: str) -> Allocator:
    """Return a rule by its name; ConfigError, with near matches, for an unknown one."""
    if name not in ALLOCATORS:
        raise unknown_name("allocation", name, ALLOCATORS)
    return ALLOCATORS[name]
