"""Live replanning: robots look for better routes on their way.

Every few seconds of its world's clock a robot looks for a better route from where it is. With routes "barred", as in
trainings, it looks only if another robot stands in or beside a cell of its route ahead. Others make moves dearer
(prices.py):

- standing, beside: entering the cell of a robot or person that stands, or a cell beside it. The price grows with the
  robot's own standing time.
- against: a move against another's route ahead. It costs more in an aisle of one cell, where two cannot pass.
- crowd: entering a cell of another's route ahead that both reach at about the same time.
- waited: entering a cell on which others waited of late.
- turn: beginning with a turn, above all in an aisle of one cell, where the robot must back out to turn round. A hairpin
  later on costs as well; otherwise the robot would go one cell ahead to turn for nothing.

A new route must save some cells at these prices. Otherwise the robot keeps its own, since a change often begins with a
manoeuvre in the way of others. docs/measured/trials.md lists what was tried.

A table (route_occupancy.py) says who stands and passes where. Robots look one after another, spread over the period by
their index, so that two that meet do not both turn away at once. A world's routes depend on its own robots alone.
"""

import hashlib
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import inline, kernel
from warehouse_env.maps.grid_map import MOVES, Cell
from warehouse_env.planning.cost_to_go import UNIT, Box, CostToGo
from warehouse_env.portable import Portable
from warehouse_env.routes.book import RouteBook
from warehouse_env.routes.goals import Pose
from warehouse_env.routes.route_table import Route
from warehouse_env.simulation.traffic.ants import make_trails
from warehouse_env.simulation.traffic.live_search import (
    NEAR,
    LiveArrays,
    LiveRoom,
    find_cells,
    first_move,
    list_route,
    runs_out_of,
)
from warehouse_env.simulation.traffic.prices import make_price_cache, prices_for
from warehouse_env.simulation.traffic.replan_search import make_labels, make_path
from warehouse_env.simulation.traffic.route_occupancy import (
    NOTHING,
    RoadUsers,
    Site,
    ahead_of,
    cell_of,
    keep_all_up,
    make_occupancy,
    note_waiting,
)

FINDERS = ("pf_aco", "astar_turns")  # planners of live routes
EVERY = 4.0  # [s] between two looks of a robot for a better route
LOOK_AHEAD = 10.0  # [m] of the route ahead that may be barred
STOOD_FOR = 6.0  # [s] without having moved a metre after which a robot counts as standing
SAVING = 0.5  # [cells] that a new route on the way must save, or the old one is kept
SLOTS = 128  # way-points of a robot's route that the table has room for
LAID = 60.0  # [m] of a robot's route that are made drivable at once; the rest when it comes NEAR
HAIRPIN = 10.0  # [cells] that a turn of more than 90 degrees costs, or routes would fold back on themselves
_BLOCK = 64  # cells by which the array of routes' cells grows
SMALL = 64  # rows and columns up to which kernels make live routes: a field there is of the whole floor


@kernel
def find_due(robots, steps, every, looks):
    """Write which robots replan now, each once in `every` steps; return how many.

    robots: ROBOT[B, N]; steps: int64[B]; looks: bool[B, N].
    """
    found, count = 0, robots.shape[1]
    for b in range(robots.shape[0]):
        for i in range(count):
            r = robots[b, i]
            turn = (steps[b] + i * every // count) % every == 0
            looks[b, i] = turn and r["task"]["alive"] != 0 and r["events"]["arrived"] == 0
            found += looks[b, i]
    return found


@inline
def _is_barred(passing, b, me, r, route, site, look_ahead):
    """Whether a robot's route leads within look_ahead [m] through a cell in or beside which another stands."""
    on_route = r["on_route"]
    if on_route["points"] < 2:
        return False
    first, columns = ahead_of(r), site.columns
    last = min(on_route["points"] - 1, first + int(look_ahead / np.float64(on_route["spacing"])))
    own = passing.stands_on[b, me]  # nobody bars his own way
    for k in range(first, last + 1):
        cell = cell_of(route[k, 0], route[k, 1], site)
        others = passing.standing[b, cell, 0] + passing.standing[b, cell, 1]
        apart = max(abs(own // columns - cell // columns), abs(own % columns - cell % columns))
        if own != NOTHING and apart <= 1 + passing.spread:
            others -= 1
        if others > 0:
            return True
    return False


@kernel
def keep_barred(passing, users, site, look_ahead, laid, steps, looks):
    """Keep `looks` only for robots whose way is barred, or whose laid route runs out.

    laid: float32[B, N] [m]; steps: int64[B]; looks: bool[B, N].
    """
    for b, i in np.ndindex(looks.shape):
        if looks[b, i]:
            keep_all_up(passing, b, steps[b], users, site)
            r = users.robots[b, i]
            barred = _is_barred(passing, b, i, r, users.routes[b, i], site, look_ahead)
            looks[b, i] = barred or runs_out_of(r, laid[b, i])


def live_planner(config: EnvConfig) -> Any:
    """Return the planner of live routes: the config's own if it makes any, else astar_turns."""
    from warehouse_env.planning import make_planner

    planner = make_planner(config.planner)
    return planner if planner.name in FINDERS else make_planner("astar_turns")


class LiveRoutes(Portable):
    """Replanning while robots drive: `watch` lists the robots that replan now, `route` makes a route from a pose.

    `arrays` are what kernels need to make routes (`find_live`); `by_kernel`: whether they can.
    """

    bound = ("_fields", "_room", "arrays")

    def __init__(self, config: EnvConfig, book: RouteBook, persons: NDArray[Any], number: NDArray[np.int32]) -> None:
        """Make the live routes of a configuration; persons: PERSON[B, M]; number: int32[H, W], of endpoints, or -1."""
        grid = book.grid
        planner = live_planner(config)
        self.finder = planner.name
        self.plans_first = planner.name == config.planner.partition(":")[0]  # not only on the way
        self.by_kernel = planner.name == "astar_turns" and max(grid.shape) <= SMALL
        self._gentleness = planner.gentleness
        self._book = book
        seconds = config.action_repeat * config.time_step
        self._every, self._only_barred = max(1, round(EVERY / seconds)), config.traffic_spec.routes == "barred"
        behind = np.array([robot.rear_reach - 0.5 * robot.length for robot in config.robots], np.float32)
        robot, size = config.widest_body, config.widest_body.longer / grid.cell_size  # of bodies, in cells
        spread = int(0.5 * (robot.length + robot.width) / grid.cell_size)
        fastest = max(max(kind.max_speed, -kind.min_speed) for kind in config.kinds)
        each = len(persons), config.num_agents
        self._own: dict[str, Any] = {
            "passing": make_occupancy(*each, grid.occupied.size, SLOTS, spread),
            "persons": persons, "person_on": np.full(persons.shape, NOTHING, np.int32),
            "laid": np.full(each, np.inf, np.float32), "cells": np.zeros((*each, _BLOCK, 2), np.int32),
            "counts": np.zeros(each, np.int32), "changed": np.zeros(each, np.bool_),
            "site": Site(np.float32(grid.cell_size), *grid.shape, STOOD_FOR, behind), "number": number,
            "prices": prices_for(size, spread), "hairpin": round(UNIT * HAIRPIN * size),
            "saving": round(UNIT * SAVING), "reach": LAID if EVERY * fastest < NEAR / 2 else math.inf,
        }  # fmt: skip
        self._bind()

    def _bind(self) -> None:
        grid = self._book.grid
        self._fields = CostToGo(grid, self._gentleness)
        self._room = self.room()
        endpoints = len(grid.endpoints[2]) if self.by_kernel else 0
        self.arrays = LiveArrays(
            **self._own, known=np.zeros(endpoints, np.bool_), fields=np.empty((endpoints, *grid.shape), np.int32),
            steps=self._fields.steps, floor=self._book.floor,
        )  # fmt: skip

    def begin(self, world: int) -> None:
        """Forget all that is known of a world: its robots begin anew."""
        arrays, passing = self.arrays, self.arrays.passing
        passing.first[world] = passing.stands_on[world] = passing.known_at[world] = passing.cell[world] = NOTHING
        arrays.person_on[world] = NOTHING
        passing.low[world] = passing.high[world] = passing.standing[world] = 0
        passing.waited[world] = passing.waited_in[world] = passing.period[world] = 0
        arrays.laid[world], arrays.counts[world] = math.inf, 0

    def room(self) -> LiveRoom:
        """Return scratch for a thread that makes routes."""
        shape = self._book.grid.shape
        asked = make_price_cache(shape[0] * shape[1])
        ants = self.finder == "pf_aco"
        labels, trails = (None, make_trails(*shape)) if ants else (make_labels(*shape), None)
        return LiveRoom(asked, labels, trails, make_path(shape[0] * shape[1]))

    def take_up(
        self, robots: NDArray[Any], routes: NDArray[np.float32], world: int, robot: int,
        cells: NDArray[np.int32], laid: float,
    ) -> None:  # fmt: skip
        """List the new route of a robot in the table, and keep the cells that it was made of.

        robots: ROBOT[B, N]; routes: float32[B, N, R, 2] [m]; cells: int32[L, 2]; laid [m]: how much is drivable.
        """
        self.make_room(len(cells))
        list_route((world, robot), cells, laid, self._users(robots, routes), self.arrays)

    def make_room(self, cells: int) -> None:
        held = self.arrays.cells
        if cells > held.shape[2]:
            larger = np.zeros((*held.shape[:2], -(-cells // _BLOCK) * _BLOCK, 2), np.int32)
            larger[:, :, : held.shape[2]] = held
            self._own["cells"], self.arrays = larger, self.arrays._replace(cells=larger)

    def know_all(self) -> None:
        """Let kernels know the fields of all endpoints."""
        for goal in self._book.grid.endpoints[2]:
            self._around(goal, goal)

    def _users(self, robots: NDArray[Any], routes: NDArray[np.float32]) -> RoadUsers:
        return RoadUsers(robots, routes, self.arrays.persons, self.arrays.person_on)

    def watch(self, robots: NDArray[Any], routes: NDArray[np.float32], steps: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return bool[B, N]: the robots that replan after this step. robots: ROBOT[B, N]."""
        looks, arrays = np.empty(robots.shape, np.bool_), self.arrays
        found = find_due(robots, steps, self._every, looks)
        note_waiting(arrays.passing, robots, looks, steps, self._every, arrays.site)
        if found and self._only_barred:
            users = self._users(robots, routes)
            keep_barred(arrays.passing, users, arrays.site, LOOK_AHEAD, arrays.laid, steps, looks)
        return looks

    def route(
        self, robots: NDArray[Any], routes: NDArray[np.float32], world: int, me: int, step: int, goal: Cell,
        on_its_way: bool = False, ends: tuple[Pose, ...] = (),
    ) -> Route | None:  # fmt: skip
        """Return a route from where a robot is to a goal, or one of `ends` there, around all others.

        None where there is no way, or the robot is in the goal's cell already: its route leads to its end. Also for
        one `on_its_way` there, if a new route would save too little. robots: ROBOT[B, N]; routes: float32[B, N, R, 2]
        [m]; step: the world's env step.
        """
        motion, arrays = robots[world, me]["motion"], self.arrays
        pose = np.array([motion["x"], motion["y"]])
        row, column = self._book.grid.standing(pose).tolist()
        if (row, column) == goal:
            return None
        field, (top, left, _, _) = self._around((row, column), goal)
        drawn_from = f"{step} {me} {row} {column} {goal}".encode()
        seed = 1 + int.from_bytes(hashlib.blake2b(drawn_from, digest_size=7).digest(), "little")
        where, when = ((row, column), (field, top, left)), (step, on_its_way, seed)
        count = find_cells((world, me), *where, when, self._users(robots, routes), arrays, self._room)
        return self._book.along(self._room.path[:count].astype(np.int32), pose, arrays.reach, ends) if count else None

    def _around(self, cell: Cell, goal: Cell) -> tuple[NDArray[np.int32], Box]:
        """Return the field of a goal around a cell and its box, and let kernels know it."""
        field, box = self._fields.around(cell, goal)
        number = self.arrays.number[goal]
        if self.by_kernel and number >= 0 and not self.arrays.known[number]:
            self.arrays.fields[number], self.arrays.known[number] = field, True
        return field, box

    def towards(self, cell: Cell, goal: Cell) -> NDArray[np.float32] | None:
        """Return the direction (x, y) of a cheapest way from a cell to a goal; None where there is none."""
        field, (top, left, _, _) = self._around(cell, goal)
        move = first_move(field, top, left, self.arrays.steps, *cell)
        if move == NOTHING:
            return None
        row, column = MOVES[move].tolist()
        return np.array([column, -row], np.float32)
