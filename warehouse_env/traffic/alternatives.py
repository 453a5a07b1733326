"""Several good routes for one task: differences between routes, a varied choice, and penalised search."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning.plan import Planner, path_length
from warehouse_env.traffic.conflicts import Route


def differences(routes: Sequence[Route], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return float64[N, N]: the Jaccard distances of the routes' cells."""
    visits = np.zeros((len(routes), shape[0] * shape[1]))
    for row, route in zip(visits, routes, strict=True):
        row[route[:, 0] * shape[1] + route[:, 1]] = 1.0
    shared = visits @ visits.T
    size = shared.diagonal()
    distance: NDArray[np.float64] = 1.0 - shared / (size[:, None] + size - shared)
    return distance


def varied(
    routes: Sequence[Route], cost: NDArray[np.float64], shape: tuple[int, int], k: int, slack: float
) -> list[int]:
    """Return the indices of up to k routes that differ much among those within (1 + slack) of the cheapest.

    cost: float64[N] of each route. The first is the cheapest; each next one has the largest difference from the
    nearest of those taken, ties to the cheaper.
    """
    if k < 1 or slack < 0:
        raise ConfigError(f"k={k} must be at least 1 and slack={slack} at least 0")
    order = np.argsort(cost, kind="stable")
    near = order[cost[order] <= cost[order[0]] * (1.0 + slack) + 1e-9]
    distance = differences([routes[index] for index in near], shape)
    taken = [0]
    while len(taken) < min(k, len(near)):
        apart = distance[:, taken].min(axis=1)
        best = int(np.argmax(apart))
        if apart[best] <= 0.0:
            break
        taken.append(best)
    return [int(near[index]) for index in taken]


def penalty_routes(
    planner: Planner,
    grid: GridMap,
    start: Cell,
    goal: Cell,
    k: int,
    rng: np.random.Generator,
    *,
    slack: float = 0.1,
    penalty: float = 0.2,
    searches: int = 24,
) -> list[Route]:
    """Return up to k different routes, the shortest first, by repeated searches with used cells made dearer.

    Iterated penalties (Johnson, Joy, Clarke & Jacobi 1993) with any planner that takes a cost map: each found route
    adds `penalty` [cells] to the cost of entering its inner cells; of all routes found in `searches` searches within
    (1 + slack) of the shortest, `varied` chooses. Empty where there is no path.
    """
    cost = np.zeros(grid.shape)
    found: dict[bytes, Route] = {}
    lengths: list[float] = []
    for _ in range(searches):
        plan = planner.plan(grid, start, goal, rng, cost)
        if not plan.found:
            return []
        if plan.cells.tobytes() not in found:
            found[plan.cells.tobytes()] = plan.cells
            lengths.append(path_length(plan.cells))
        cost[tuple(plan.cells[1:-1].T)] += penalty
    routes = list(found.values())
    return [routes[index] for index in varied(routes, np.array(lengths), grid.shape, k, slack)]
