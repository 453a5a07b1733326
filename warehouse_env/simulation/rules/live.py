"""Live routes: robots are routed anew on their way, around others that stand and away from where others are going.

Every few seconds of its world's clock a robot looks for a better route from where it is (with `only_barred`, as in
trainings, only if its own leads through a cell in or beside which another has not moved a metre for some seconds),
planned on a cost map:

- entering the cell of a robot that stands, or one beside it, costs, the more the longer one stands oneself;
- a move against one of another's remaining route costs, so that streams part, and the more in an aisle of one cell,
  where the two could not pass (traffic/conflicts.py prices expected conflicts of whole routes; here the routes are on
  their way, and only the opposing moves of what is left count);
- entering a cell of another's remaining route costs if both will be there at about the same time, so that robots
  spread over the floor before they crowd: it costs the most where both are as far from that cell;
- beginning with a turn costs, the more in an aisle of one cell, where a robot must back out to turn round; turning
  back sharply later on costs as well (`hairpin` of the planner), or one would go a cell ahead to turn for nothing.

A new route on the way must save some cells at these prices, or the old one is kept: a change of route often begins with
a manoeuvre, in everybody's way. What was tried, of these prices and of others: docs/measured/trials.md.

Robots look one after another, spread over the period by their index, so two that meet do not both turn away at once,
and no step does the work of all. Nothing is drawn by chance: a world's routes depend on its own robots alone.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import Cell
from warehouse_env.planning.plan import DEAREST
from warehouse_env.routes.book import RouteBook
from warehouse_env.simulation.rules.prices import (
    PRICES,
    ahead_of,
    body_cell,
    cell_of,
    cells_ahead,
    path_cost,
    price,
    way,
)
from warehouse_env.simulation.rules.waits import bars_routes


@kernel
def _mark(stands, row, column, change):
    """Add `change` to the cells in and beside which a robot stands; stands: int32[H, W]."""
    for i in range(max(row - 1, 0), min(row + 2, stands.shape[0])):
        for j in range(max(column - 1, 0), min(column + 2, stands.shape[1])):
            stands[i, j] += change


@kernel
def _is_barred(r, route, look_ahead, stands, cell):
    """Whether a robot's route leads within look_ahead [m] through a cell in or beside which another stands."""
    if r["points"] < 2:
        return False
    first = ahead_of(r)
    last = min(r["points"] - 1, first + int(look_ahead / np.float64(r["spacing"])))
    for k in range(first, last + 1):
        row, column = cell_of(route[k, 0], route[k, 1], cell, stands.shape[0], stands.shape[1])
        if stands[row, column] > 0:
            return True
    return False


@kernel
def find_due(robots, steps, every, looks):
    """Write which robots look for a better way now, each once in `every` steps; return how many.

    robots: ROBOT[B, N]; steps: int64[B]; looks: bool[B, N].
    """
    found, count = 0, robots.shape[1]
    for b in range(robots.shape[0]):
        for i in range(count):
            r = robots[b, i]
            due = r["alive"] != 0 and r["arrived"] == 0 and (steps[b] + i * every // count) % every == 0
            looks[b, i] = due
            found += due
    return found


@kernel
def keep_barred(robots, routes, stood_for, look_ahead, behind, cell, stands, looks):
    """Let only those look whose way is barred; return how many.

    robots: ROBOT[B, N]; routes: float32[B, N, R, 2] [m]; behind [m]: a body's centre, behind its front axle; stands:
    int32[H, W], zeros; looks: bool[B, N].
    """
    found, (rows, columns) = 0, stands.shape
    for b in range(robots.shape[0]):
        for r in robots[b]:
            if bars_routes(r, stood_for):
                row, column = body_cell(r, behind, cell, rows, columns)
                _mark(stands, row, column, 1)
        for i in range(robots.shape[1]):
            if not looks[b, i]:
                continue
            r = robots[b, i]
            own = bars_routes(r, stood_for)  # nobody bars his own way
            row, column = body_cell(r, behind, cell, rows, columns)
            if own:
                _mark(stands, row, column, -1)
            looks[b, i] = _is_barred(r, routes[b, i], look_ahead, stands, cell)
            found += looks[b, i]
            if own:
                _mark(stands, row, column, 1)
        stands[:] = 0
    return found


class LiveRoutes:
    """Makes routes while robots drive: `watch` says who looks for a better one, `route` makes it from its pose."""

    def __init__(self, config: EnvConfig, book: RouteBook) -> None:
        """Take the configuration's `reroute_spec`; ConfigError for a planner that takes no cost map."""
        from warehouse_env.planning import make_planner

        spec, grid = config.reroute_spec, book.grid
        planner = make_planner(spec.planner)
        if not planner.takes_cost:
            raise ConfigError(
                f"planner {planner.name} takes no cost map and cannot plan live routes; choose one with takes_cost, "
                "such as astar_turns"
            )
        self._book, self._planner = book, planner
        seconds = config.action_repeat * config.time_step
        every = max(1, round(spec.every / seconds))
        behind = np.float32(config.robot.rear_reach - 0.5 * config.robot.length)
        size = np.float32(grid.cell_size)
        self._every, self._only_barred = every, spec.only_barred
        self._barred = (spec.stood_for, spec.look_ahead, behind, size)
        self._price = (grid.legal_moves, spec.stood_for, PRICES, behind, size)
        self._size, self._saving = size, spec.saving
        self._stands = np.zeros(grid.shape, np.int32)
        self._cost = np.zeros((*grid.shape, 8))

    def watch(self, robots: NDArray[Any], routes: NDArray[np.float32], steps: NDArray[np.int64]) -> list[list[int]]:
        """Return [world, robot] of those who look for a better route after this step. robots: ROBOT[B, N]."""
        looks = np.empty(robots.shape, np.bool_)
        if not find_due(robots, steps, self._every, looks):
            return []
        if self._only_barred and not keep_barred(robots, routes, *self._barred, self._stands, looks):
            return []
        found: list[list[int]] = np.argwhere(looks).tolist()
        return found

    def route(
        self, robots: NDArray[Any], routes: NDArray[np.float32], me: int, goal: Cell, on_its_way: bool = False
    ) -> NDArray[np.float32] | None:
        """Return way-points float32[R, 2] [m] from where robot `me` of ROBOT[N] is to a goal, around all others.

        None where the planner finds no path, or the robot is in the goal's cell already: its route leads to the centre.
        Also for one `on_its_way` there, if a new route would save too little.
        """
        price(robots, routes, me, *self._price, self._cost)
        np.minimum(self._cost, DEAREST, out=self._cost)
        pose = np.array([robots[me]["x"], robots[me]["y"]])
        row, column = self._book.grid.cell(pose).tolist()
        now = math.inf
        if on_its_way:
            left = cells_ahead(robots[me], routes[me], self._size, *self._book.grid.shape)
            now = path_cost(left, self._cost)
            if way(row - goal[0], column - goal[1]) + self._saving > now:
                return None  # no path could save enough, so none is searched for
        rng = np.random.default_rng([row, column, *goal])
        plan = self._planner.plan(self._book.grid, (row, column), goal, rng, self._cost)
        if not plan.found or len(plan.cells) < 2 or path_cost(plan.cells, self._cost) + self._saving > now:
            return None
        return self._book.lay(plan.cells, pose)
