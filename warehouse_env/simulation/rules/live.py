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

A new route on the way must save some cells at these prices, or the old one is kept: where only the barred look, of the
new ones at 128 robots, one every 14 s for each robot, 23% were followed by a manoeuvre, in everybody's way.

What was tried, late goals per robot-hour by right of way on trial seeds; intervals are 2 to 4 wide either way, so many
differences may be chance. First 64 robots for 600 s, of which the last 300 count:

| one value changed | narrow | paper46 | aisles, seed 101 |
|---|--:|--:|--:|
| none: turn 1, against 1, look_ahead 25, every 4, stood_for 6 | 78.5 | 123 | 81 |
| turn 0, 3, 6 | 76.5, 81.4, 81.3 | | |
| against 0.3, 3 | 80.2, 71.4 | | |
| look_ahead 10 | 81.7 | | |
| stood_for 15; stood_for 3 and every 2 | 80.5; 71.0 | | |
| turn 3 and look_ahead 10, where right of way asks 2 m ahead, not 3 | 83.0 | 127 | 85 |
| right of way asks 2 m ahead, not 3 | 81.3 | 125 | 84 |

Then 128 robots on paper46 and 64 elsewhere, for 400 s, of which the last 200 count; in the shipped order of right:

| who is longest on the way to its goal goes first | narrow | paper46 | aisles, seed 101 |
|---|--:|--:|--:|
| none: look_ahead 10, no price on crowds, every new route taken | 92.2 | 88.0 | 85.0 |
| crowd 0.6 within the next 10 m of the other, whenever | 88.1 | 98.1 | |
| crowd 0.6 within 10 m of the same way, saving 3: as it is | 96.3 | 98.2 | 89.8 |

And in an order that was not kept:

| who has waited longest goes first | narrow | paper46 | aisles, seed 101 |
|---|--:|--:|--:|
| none, as above | 91.6 | 89.9 | |
| saving 3 | 92.3 | 89.2 | |
| crowd 0.1, whenever | 93.1 | 93.2 | |
| crowd 0.3, 0.6, 1.2 within the next 10 m of the other, whenever | 93.5, 93.8, 90.8 | 96.0, 94.9, 97.4 | |
| crowd 0.3 within the next 25 m of the other, whenever | 94.4 | 99.9 | |
| crowd 0.6 within 10 m of the same way, saving 3: as it is, and all below but for what they say | 96.6 | 99.9 | 95.4 |
| crowd 1.2 so; within 5 m | 94.7; 90.0 | 98.6; 95.3 | |
| crowd 0.6 within 20 m | 90.4 | 101.7 | 94.0 |
| against 0.5 | 95.7 | 97.7 | 87.0 |
| against 1 within 20 m of the same way | 91.3 | 93.5 | 84.9 |
| against 2 so; within 40 m | 92.6; 91.8 | 100.2; 100.1 | 94.2; 97.3 |
| turn 2, but on narrow one stood for 123 s | 97.4 | 101.8 | 92.3 |
| a look at a better route every 4 s, whether the way is barred or not | 92.5 | 94.6 | 93.9 |
| stood_for 4 and every 2 | 89.8 | 95.0 | 89.2 |

Last under `threaded_ppo`, 64 robots, four worlds of 600 s on each of six floors of `aisles` (241 to 246) and on
`single_lane` and `narrow`; where there is no aisle of one cell, as on `narrow`, `boxed_against` changed no episode:

| what differs | six floors | single_lane | narrow |
|---|--:|--:|--:|
| against 1 everywhere | 109.9 | 97.2 | 104.1 |
| against 2, 4, 8, 12, 16 everywhere | 110.4, 112.6, 113.9, 112.9, 114.3 | 8: 109.3 | 8: 100.0 |
| boxed_against 8: as it is | 113.6 | 108.8 | 104.1 |
| boxed_against 16 | 113.1 | 109.1 | 104.1 |
| 8, look_ahead 20 | 113.4 | | |
| 8, and a look at a better route before every aisle of one cell | 114.2 | | |
| 8, and a look every 4 s of every robot, whether its way is barred or not: as it is | 115.2 | 109.9 | 106.9 |

That last, again on other trial seeds (four worlds each):

| who looks | six floors, 64 | 32 | narrow, 64 | paper46, 128 |
|---|--:|--:|--:|--:|
| seeds from 1,501,000: whose way is barred | 113.3 | | 102.1 | 120.1 |
| all | 115.8 | | 106.7 | 122.1 |
| seeds from 1,502,000: whose way is barred | 112.4 | 133.9 | | |
| all | 116.2 | 135.8 | 106.6 | |
| all every 8 s; every 2 s, where one stood for 514 s | 114.7; 112.3 | | 105.0; 105.8 | |
| all, a route's line (not its cells) must save 0, 3 | 115.0, 114.9 | | | |
| all but robots in a manoeuvre: first three floors 112.1, where all come to 118.8 | | | | |

Lines are laid into lanes, so a line costs 7 cells more at these prices than its cells did (median of 2,156 with 64
robots on floor 241), and a robot changes its route in every second look. Where the lines were compared instead it did
so less often, and nothing was gained.

Robots that stand cost a robot twice as much once it has stood for 20 s itself: on floor 102 of `aisles` one stood for
328 s without, for 81 s with that (4 worlds of 64 robots); twice as much after 5 s costs 6 of 92 goals on `narrow`.

Turns at 3 cells made every tenth route begin with a bend that its line could not hold: it folded, and a robot stood
for minutes where its line passed a place twice. At 1 cell, with hairpins priced, none of 1,358 began with a fold, and
one had it farther on, on its way between two that stood.

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

from warehouse_env.config import EnvConfig, RerouteSpec
from warehouse_env.errors import ConfigError
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import Cell
from warehouse_env.planning.plan import DEAREST
from warehouse_env.routes.book import RouteBook
from warehouse_env.simulation.rules.prices import (
    ahead_of,
    body_cell,
    cell_of,
    cells_ahead,
    path_cost,
    price,
    stands_still,
    way,
)


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
            if stands_still(r, stood_for):
                row, column = body_cell(r, behind, cell, rows, columns)
                _mark(stands, row, column, 1)
        for i in range(robots.shape[1]):
            if not looks[b, i]:
                continue
            r = robots[b, i]
            own = stands_still(r, stood_for)  # nobody bars his own way
            row, column = body_cell(r, behind, cell, rows, columns)
            if own:
                _mark(stands, row, column, -1)
            looks[b, i] = _is_barred(r, routes[b, i], look_ahead, stands, cell)
            found += looks[b, i]
            if own:
                _mark(stands, row, column, 1)
        stands[:] = 0
    return found


def prices_of(spec: RerouteSpec) -> tuple[float, ...]:
    """Return the prices of a RerouteSpec as `price` takes them."""
    against = (spec.against, spec.boxed_against)
    return (spec.standing, spec.beside, *against, spec.crowd, spec.crowd_within, spec.turn, spec.boxed_turn)


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
        self._price = (grid.legal_moves, spec.stood_for, prices_of(spec), behind, size)
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
