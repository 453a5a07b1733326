"""A cost map of the expected traffic on a floor, and a planner that always uses it.

Plans that depend on other robots cannot be cached; a cost map of the floor alone can. Tasks are drawn as for lifelong
robots and planned around each other until lanes settle. Driving behind others is free and driving against them is dear,
so aisles become one-way streets if there is another way back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from hashlib import blake2b
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning.graph_search import AStarTurns
from warehouse_env.planning.plan import CostMap, Plan, Planner, edge_cost
from warehouse_env.traffic.conflicts import congestion
from warehouse_env.traffic.together import Task, plan_together

TASKS = 200  # drawn to stand for the traffic
ROUNDS = 3


def endpoint_tasks(grid: GridMap, count: int, rng: np.random.Generator) -> list[Task]:
    """Return tasks between pick faces and stations, alternating in direction; ConfigError if a floor has too few.

    Endpoints are dealt in random order, repeatedly if there are fewer than tasks.
    """
    if len(np.unique(np.concatenate([grid.picks, grid.stations]), axis=0)) < 2:
        raise ConfigError(f"map {grid.name!r} has a single endpoint; a task needs two")
    decks = [rng.permutation(cells).tolist() for cells in (grid.picks, grid.stations)]
    tasks: list[Task] = []
    for k in range(2 * count):
        pick, station = (tuple(deck[k % len(deck)]) for deck in decks)
        if pick != station and len(tasks) < count:
            tasks.append((pick, station) if len(tasks) % 2 else (station, pick))
    return tasks


def expected_traffic(
    grid: GridMap, robots: int, price: float, seed: int = 0, *, directed: bool = True
) -> NDArray[np.float64]:
    """Return the cost map float64[H, W, 8] (float64[H, W] if not directed) of `robots` robots for one more.

    price: cells of detour that avoiding one expected conflict is worth.
    """
    if robots < 1:
        raise ConfigError(f"robots={robots} must be at least 1")
    tasks = endpoint_tasks(grid, TASKS, np.random.default_rng(seed))
    share = price * robots / TASKS  # each drawn route stands for so many robots
    plans = plan_together(AStarTurns(), grid, tasks, seed, price=share, directed=directed, rounds=ROUNDS)
    return congestion([plan.cells for plan in plans], grid.shape, share, share if directed else None)


@dataclass(frozen=True, eq=False)
class WithCost:
    """A planner that adds the same cost map to all its plans, so that they can be kept."""

    planner: Planner
    cost: NDArray[np.float64]  # [H, W] or [H, W, 8]

    takes_cost: ClassVar[bool] = True

    @property
    def name(self) -> str:
        """That of the planner."""
        return self.planner.name

    @cached_property
    def key(self) -> str:
        """The planner's key and the cost map's content."""
        content = blake2b(np.ascontiguousarray(self.cost, dtype=np.float64).tobytes(), digest_size=16).hexdigest()
        return f"{self.planner.key} with cost {content}"

    def plan(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator, cost: CostMap = None) -> Plan:
        """Plan with the cost map, and with `cost` on top of it."""
        if cost is None:
            return self.planner.plan(grid, start, goal, rng, self.cost)
        return self.planner.plan(grid, start, goal, rng, edge_cost(grid, self.cost) + edge_cost(grid, cost))
