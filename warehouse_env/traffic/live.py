"""Live routes: robots are routed anew around others that stand, and all new routes heed where the others are going.

Every few seconds of its world's clock a robot looks down its route. If it leads through a cell in or beside which
another has not moved a metre for some seconds, it gets a new one from where it stands, planned on a cost map:

- entering the cell of a robot that stands, or one beside it, costs;
- a move against one of another's remaining route costs, so that streams part (traffic/conflicts.py prices expected
  conflicts of whole routes; here the routes are on their way, and only the opposing moves of what is left count);
- beginning with a turn costs, the more in an aisle of one cell, where a robot must back out to turn round; turning
  back sharply later on costs as well (`hairpin` of the planner), or one would go a cell ahead to turn for nothing.

What was tried, late goals per robot-hour (of 600 s, the last 300) by right of way, 64 robots on trial seeds; intervals
are 2 to 4 wide either way, so many of these differences may be chance:

| one value changed | narrow | paper46 | aisles, seed 101 |
|---|--:|--:|--:|
| none: turn 1, against 1, look_ahead 25, every 4, stood_for 6 | 78.5 | 123 | 81 |
| turn 0, 3, 6 | 76.5, 81.4, 81.3 | | |
| against 0.3, 3 | 80.2, 71.4 | | |
| look_ahead 10 | 81.7 | | |
| stood_for 15; stood_for 3 and every 2 | 80.5; 71.0 | | |
| turn 3 and look_ahead 10, where right of way asks 2 m ahead, not 3 | 83.0 | 127 | 85 |
| right of way asks 2 m ahead, not 3 | 81.3 | 125 | 84 |

Turns at 3 cells made every tenth route begin with a bend that its line could not hold: it folded, and a robot stood
for minutes where its line passed a place twice. At 1 cell, with hairpins priced, no route of 1,900 folds.

Prices on whole classes of lanes (12: which lane, aisle and rim, each way), optimised by CMA-ES for `narrow` with 64
robots (80 evaluations of 3 x 300 s), came to 84.0 on eight other trial seeds, without them 81.9: [-1.1, 5.3] more, so
nothing that could be told. Under `ppo` without right of way live routes were all: 14 to 106 on paper46 and 7 to 58 on
narrow.

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
from warehouse_env.kernel import inline, kernel
from warehouse_env.maps.grid_map import MOVES, Cell
from warehouse_env.routes.book import RouteBook


@inline
def _cell_of(x, y, cell, rows, columns):  # type: ignore[no-untyped-def]
    """Return (row, column) of the cell that holds a point [m], on the floor."""
    row = rows - 1 - int(math.floor(y / cell))
    return min(max(row, 0), rows - 1), min(max(int(math.floor(x / cell)), 0), columns - 1)


@inline
def _body_cell(r, behind, cell, rows, columns):  # type: ignore[no-untyped-def]
    """Return (row, column) of the cell that holds the centre of a body, `behind` [m] the front axle."""
    return _cell_of(r["x"] - behind * r["cos"], r["y"] - behind * r["sin"], cell, rows, columns)


@kernel
def _mark(stands, row, column, change):  # type: ignore[no-untyped-def]
    """Add `change` to the cells in and beside which a robot stands; stands: int32[H, W]."""
    for i in range(max(row - 1, 0), min(row + 2, stands.shape[0])):
        for j in range(max(column - 1, 0), min(column + 2, stands.shape[1])):
            stands[i, j] += change


@kernel
def _is_barred(r, route, look_ahead, stands, cell):  # type: ignore[no-untyped-def]
    """Whether a robot's route leads within look_ahead [m] through a cell in or beside which another stands."""
    if r["points"] < 2:
        return False
    first = int(r["position"] / r["spacing"]) + 1
    last = min(r["points"] - 1, first + int(look_ahead / r["spacing"]))
    for k in range(first, last + 1):
        row, column = _cell_of(route[k, 0], route[k, 1], cell, stands.shape[0], stands.shape[1])
        if stands[row, column] > 0:
            return True
    return False


@inline
def _stands(r, stood_for):  # type: ignore[no-untyped-def]
    """Whether a robot has not left its place by a metre for so long [s], or is parked for good."""
    return r["alive"] == 0 or r["standing_time"] >= stood_for


@kernel
def watch(robots, routes, steps, every, stood_for, look_ahead, behind, cell, stands, barred):  # type: ignore[no-untyped-def]
    """Write which robots are to be routed anew; return how many.

    robots: ROBOT[B, N]; routes: float32[B, N, R, 2] [m]; steps: int64[B]; every: the steps
    between two looks of a robot; behind [m]: a body's centre, behind its front axle; stands: int32[H, W], zeros;
    barred: bool[B, N].
    """
    found, count = 0, robots.shape[1]
    rows, columns = stands.shape
    for b in range(robots.shape[0]):
        standing = 0
        for i in range(count):
            r = robots[b, i]
            barred[b, i] = False
            if _stands(r, stood_for):
                row, column = _body_cell(r, behind, cell, rows, columns)
                _mark(stands, row, column, 1)
                standing += 1
        if standing == 0:
            continue
        for i in range(count):
            r = robots[b, i]
            if r["alive"] == 0 or r["arrived"] != 0 or (steps[b] + i * every // count) % every != 0:
                continue
            row, column = _body_cell(r, behind, cell, rows, columns)
            own = _stands(r, stood_for)
            if own:
                _mark(stands, row, column, -1)
            if _is_barred(r, routes[b, i], look_ahead, stands, cell):
                barred[b, i] = True
                found += 1
            if own:
                _mark(stands, row, column, 1)
        stands[:] = 0
    return found


@kernel
def _charge_entry(cost, row, column, price):  # type: ignore[no-untyped-def]
    """Add a price to all moves that enter a cell, if it is on the floor. cost: float64[H, W, 8]."""
    rows, columns = cost.shape[0], cost.shape[1]
    if not (0 <= row < rows and 0 <= column < columns):
        return
    for move in range(8):
        i, j = row - MOVES[move, 0], column - MOVES[move, 1]
        if 0 <= i < rows and 0 <= j < columns:
            cost[i, j, move] += price


@kernel
def _charge_against(cost, r, route, price, cell):  # type: ignore[no-untyped-def]
    """Add a price to each move against one of a robot's remaining route, and half of it to the moves beside it."""
    rows, columns = cost.shape[0], cost.shape[1]
    row, column = _cell_of(r["x"], r["y"], cell, rows, columns)
    for k in range(int(r["position"] / max(r["spacing"], np.float32(1e-6))) + 1, r["points"]):
        i, j = _cell_of(route[k, 0], route[k, 1], cell, rows, columns)
        if i == row and j == column:
            continue
        back = _eighth(row - i, column - j)
        cost[i, j, back] += price
        cost[i, j, (back + 1) % 8] += 0.5 * price
        cost[i, j, (back + 7) % 8] += 0.5 * price
        row, column = i, j


@kernel
def _eighth(d_row, d_column):  # type: ignore[no-untyped-def]
    """Return the index of the move of MOVES that is nearest to a direction in rows and columns."""
    return int(round(math.atan2(-d_row, d_column) / (0.25 * math.pi))) % 8


@kernel
def _charge_turns(cost, r, row, column, legal, turn, boxed_turn):  # type: ignore[no-untyped-def]
    """Add the prices of turning away from a robot's heading to the moves that leave its cell."""
    ahead = int(round(r["heading"] / (0.25 * math.pi))) % 8
    boxed = not (legal[row, column, (ahead + 2) % 8] or legal[row, column, (ahead + 6) % 8])
    for move in range(8):
        off = (move - ahead) % 8
        off = min(off, 8 - off)
        cost[row, column, move] += turn * (0.0, 0.2, 1.0, 2.0, 2.0)[off]
        if boxed and off > 2:
            cost[row, column, move] += boxed_turn


@kernel
def price(robots, routes, me, legal, stood_for, standing, beside, against, turn, boxed_turn, behind, cell, cost):  # type: ignore[no-untyped-def]
    """Write the cost map float64[H, W, 8] [cells] that the others of a world make for robot `me`.

    robots: ROBOT[N]; routes: float32[N, R, 2] [m]; legal: bool[H, W, 8]; prices [cells] as in RerouteSpec.
    """
    rows, columns = cost.shape[0], cost.shape[1]
    cost[:] = 0.0
    for other in range(robots.shape[0]):
        r = robots[other]
        if other == me:
            continue
        if _stands(r, stood_for):
            row, column = _body_cell(r, behind, cell, rows, columns)
            for i in range(row - 1, row + 2):
                for j in range(column - 1, column + 2):
                    _charge_entry(cost, i, j, standing if i == row and j == column else beside)
        if against > 0.0 and r["alive"] != 0:
            _charge_against(cost, r, routes[other], against, cell)
    row, column = _cell_of(robots[me]["x"], robots[me]["y"], cell, rows, columns)
    _charge_turns(cost, robots[me], row, column, legal, turn, boxed_turn)


class LiveRoutes:
    """Makes routes while robots drive: `watch` says whose way is barred, `route` makes a new one from its pose."""

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
        self._watch = (every, spec.stood_for, spec.look_ahead, behind, size)
        prices = (spec.standing, spec.beside, spec.against, spec.turn, spec.boxed_turn)
        self._price = (grid.legal_moves, spec.stood_for, *prices, behind, size)
        self._stands = np.zeros(grid.shape, np.int32)
        self._cost = np.zeros((*grid.shape, 8))

    def watch(self, robots: NDArray[Any], routes: NDArray[np.float32], steps: NDArray[np.int64]) -> list[list[int]]:
        """Return [world, robot] of those who are to be routed anew after this step. robots: ROBOT[B, N]."""
        barred = np.empty(robots.shape, np.bool_)
        if not watch(robots, routes, steps, *self._watch, self._stands, barred):
            return []
        found: list[list[int]] = np.argwhere(barred).tolist()
        return found

    def route(
        self, robots: NDArray[Any], routes: NDArray[np.float32], me: int, goal: Cell
    ) -> NDArray[np.float32] | None:
        """Return way-points float32[R, 2] [m] from where robot `me` of ROBOT[N] is to a goal, around all others.

        None where the planner finds no path, or the robot is in the goal's cell already: its route leads to the centre.
        """
        price(robots, routes, me, *self._price, self._cost)
        pose = np.array([robots[me]["x"], robots[me]["y"]])
        row, column = self._book.grid.cell(pose).tolist()
        rng = np.random.default_rng([row, column, *goal])
        plan = self._planner.plan(self._book.grid, (row, column), goal, rng, self._cost)
        return self._book.lay(plan.cells, pose) if plan.found and len(plan.cells) > 1 else None
