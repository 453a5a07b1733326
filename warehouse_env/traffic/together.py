"""Joint planning: robots are planned one after another, each around the others' routes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError, PlanError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning.plan import Plan, Planner, path_length
from warehouse_env.traffic.conflicts import Route, Timing, conflict_table, congestion

Task = tuple[Cell, Cell]


def plan_together(
    planner: Planner,
    grid: GridMap,
    tasks: Sequence[Task],
    seed: int = 0,
    *,
    price: float = 1.0,
    directed: bool = True,
    rounds: int = 2,
) -> list[Plan]:
    """Return a plan for each task (start, goal), each on the cost map of the other robots' current routes.

    price: cells of detour that avoiding one expected conflict is worth. directed: a cost a move, so that driving behind
    others is free and driving against them is dear; otherwise a cost a cell. rounds: in the first a robot knows only
    the robots before it; in each further one it is planned again around all others. With an exact planner no step
    after the first round raises length + price * the robot's expected conflicts. ConfigError for a planner that takes
    no cost map, PlanError for a task without a path.
    """
    if rounds < 1:
        raise ConfigError(f"rounds={rounds} must be at least 1")
    plans: list[Plan | None] = [None] * len(tasks)
    for turn in range(rounds):
        for robot, (start, goal) in enumerate(tasks):
            others = [plan.cells for k, plan in enumerate(plans) if plan is not None and k != robot]
            cost = congestion(others, grid.shape, price, price if directed else None) if others else None
            plan = planner.plan(grid, start, goal, np.random.default_rng([seed, turn, robot]), cost)
            if not plan.found:
                raise PlanError(f"planner {planner.name} found no path from {start} to {goal} on map {grid.name!r}")
            plans[robot] = plan
    return [plan for plan in plans if plan is not None]


def choose_together(
    candidates: Sequence[Sequence[Route]], shape: tuple[int, int], price: float = 1.0, timing: Timing = "lifelong"
) -> list[int]:
    """Return which of its candidate routes each robot should take, so that they meet each other little.

    Lowers the sum of all lengths + price [cells] * expected conflicts between all pairs, one robot at a time, from the
    first candidates until no robot alone can better it; ties go to the earlier candidate.
    """
    if not all(candidates):
        raise ConfigError("every robot needs at least one candidate route")
    routes = [route for own in candidates for route in own]
    table = conflict_table(routes, shape, timing).sum(axis=2)
    length = np.array([path_length(route) for route in routes])
    first = np.cumsum([0, *map(len, candidates)])[:-1]
    chosen = first.copy()
    changed = True
    while changed:
        changed = False
        for robot, own in enumerate(candidates):
            others = np.delete(chosen, robot)
            ways = np.arange(first[robot], first[robot] + len(own))
            total: NDArray[np.float64] = length[ways] + price * table[np.ix_(ways, others)].sum(axis=1)
            best = int(ways[np.argmin(total)])
            if total[best - first[robot]] < total[chosen[robot] - first[robot]] - 1e-9:
                chosen[robot], changed = best, True
    return [int(index) for index in chosen - first]
