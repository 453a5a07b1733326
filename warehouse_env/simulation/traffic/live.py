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

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import inline, kernel
from warehouse_env.maps.grid_map import MOVES, Cell
from warehouse_env.planning.cost_to_go import UNIT, CostToGo, to_go
from warehouse_env.portable import Portable
from warehouse_env.routes.book import RouteBook
from warehouse_env.routes.goals import Pose
from warehouse_env.routes.route_table import Route
from warehouse_env.simulation.traffic.ants import make_trails, send_ants
from warehouse_env.simulation.traffic.prices import ReplanQuery, make_price_cache, prices_for
from warehouse_env.simulation.traffic.replan_search import find_way, make_labels
from warehouse_env.simulation.traffic.route_occupancy import (
    NOTHING,
    RoadUsers,
    Site,
    ahead_of,
    cell_of,
    forget_route,
    keep_all_up,
    keep_up,
    make_occupancy,
    note_waiting,
)

# Of live routes, by the name of their planner: the kernel, and what makes room for it on a floor.
FINDERS: dict[str, tuple[Any, Any]] = {"pf_aco": (send_ants, make_trails), "astar_turns": (find_way, make_labels)}
EVERY = 4.0  # [s] between two looks of a robot for a better route
LOOK_AHEAD = 10.0  # [m] of the route ahead that may be barred
STOOD_FOR = 6.0  # [s] without having moved a metre after which a robot counts as standing
SAVING = 0.5  # [cells] that a new route on the way must save, or the old one is kept
SLOTS = 128  # way-points of a robot's route that the table has room for
HORIZON = 40  # [cells] from a robot up to which it looks; from there its way is the shortest
LAID = 60.0  # [m] of a robot's route that are made drivable at once; the rest when it comes near
_NEAR = 25.0  # [m] from the end of that at which it is
HAIRPIN = 10.0  # [cells] that a turn of more than 90 degrees costs, or routes would fold back on themselves
_NO_CELLS = np.empty((0, 2), np.int32)


@kernel
def find_due(robots, steps, every, looks):
    """Write which robots replan now, each once in `every` steps; return how many.

    robots: ROBOT[B, N]; steps: int64[B]; looks: bool[B, N].
    """
    found, count = 0, robots.shape[1]
    for b in range(robots.shape[0]):
        for i in range(count):
            r = robots[b, i]
            due = (
                r["task"]["alive"] != 0 and r["events"]["arrived"] == 0 and (steps[b] + i * every // count) % every == 0
            )
            looks[b, i] = due
            found += due
    return found


@kernel
def runs_out_of(r, laid):
    """Whether a robot comes near the end of what is laid of its route, which is `laid` [m] long."""
    on_route = r["on_route"]
    return on_route["position"] + np.float32(_NEAR) > laid and laid < (on_route["points"] - 1) * on_route["spacing"]


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
    """Replanning while robots drive: `watch` lists the robots that replan now, `route` makes a route from a pose."""

    bound = ("_fields", "_asked", "_room")

    def __init__(self, config: EnvConfig, book: RouteBook, persons: NDArray[Any]) -> None:
        """Make the live routes of a configuration; persons: PERSON[B, M]."""
        self._persons, self._person_on = persons, np.full(persons.shape, NOTHING, np.int32)  # see RoadUsers
        grid = book.grid
        planner = live_planner(config)
        self.finder = planner.name
        self.plans_first = planner.name == config.planner.partition(":")[0]  # not only on the way
        self._gentleness = planner.gentleness
        self._book = book
        seconds = config.action_repeat * config.time_step
        self._every, self._only_barred = max(1, round(EVERY / seconds)), config.traffic_spec.routes == "barred"
        behind = np.array([robot.rear_reach - 0.5 * robot.length for robot in config.robots], np.float32)
        self._site = Site(np.float32(grid.cell_size), *grid.shape, STOOD_FOR, behind)
        robot, size = config.widest_body, config.widest_body.longer / grid.cell_size  # of bodies, in cells
        spread = int(0.5 * (robot.length + robot.width) / grid.cell_size)
        self._prices = prices_for(size, spread)
        self._hairpin = round(UNIT * HAIRPIN * size)
        self._saving = round(UNIT * SAVING)
        self._passing = make_occupancy(len(persons), config.num_agents, grid.occupied.size, SLOTS, spread)
        self._laid = np.full((len(persons), config.num_agents), np.inf, np.float32)  # [m] of routes that are drivable
        fastest = max(max(kind.max_speed, -kind.min_speed) for kind in config.kinds)
        self._reach = LAID if EVERY * fastest < _NEAR / 2 else np.inf
        self._cells: dict[tuple[int, int], NDArray[np.int32]] = {}  # [L, 2], those that a robot's route was made of
        self._bind()

    def _bind(self) -> None:
        grid = self._book.grid
        self._fields, self._asked = CostToGo(grid, self._gentleness), make_price_cache(grid.occupied.size)
        self._room = FINDERS[self.finder][1](*grid.shape)

    def begin(self, world: int) -> None:
        """Forget all that is known of a world: its robots begin anew."""
        passing = self._passing
        passing.first[world] = passing.stands_on[world] = passing.known_at[world] = passing.cell[world] = NOTHING
        self._person_on[world] = NOTHING
        passing.low[world] = passing.high[world] = passing.standing[world] = 0
        passing.waited[world] = passing.waited_in[world] = passing.period[world] = 0
        self._laid[world] = np.inf
        for robot in range(passing.low.shape[1]):
            self._cells[world, robot] = _NO_CELLS

    def give_up(self, world: int, robot: int) -> None:
        """Forget a robot's route, for it gets another."""
        forget_route(self._passing, world, robot)

    def take_up(
        self, robots: NDArray[Any], routes: NDArray[np.float32], world: int, robot: int,
        cells: NDArray[np.int32], laid: float,
    ) -> None:  # fmt: skip
        """List the new route of a robot in the table, and keep the cells that it was made of.

        robots: ROBOT[B, N]; routes: float32[B, N, R, 2] [m]; cells: int32[L, 2]; laid [m]: how much is drivable.
        """
        self._cells[world, robot] = cells
        self._laid[world, robot] = laid
        keep_up(self._passing, world, robot, robots[world, robot], routes[world, robot], self._site)

    def watch(self, robots: NDArray[Any], routes: NDArray[np.float32], steps: NDArray[np.int64]) -> list[list[int]]:
        """Return [world, robot] of the robots that replan after this step. robots: ROBOT[B, N]."""
        looks = np.empty(robots.shape, np.bool_)
        if not find_due(robots, steps, self._every, looks):
            return []
        note_waiting(self._passing, robots, looks, steps, self._every, self._site)
        if self._only_barred:
            users = RoadUsers(robots, routes, self._persons, self._person_on)
            keep_barred(self._passing, users, self._site, LOOK_AHEAD, self._laid, steps, looks)
        found: list[list[int]] = np.argwhere(looks).tolist()
        return found

    def route(
        self, robots: NDArray[Any], routes: NDArray[np.float32], world: int, me: int, step: int, goal: Cell,
        on_its_way: bool = False, ends: tuple[Pose, ...] = (),
    ) -> Route | None:  # fmt: skip
        """Return a route from where a robot is to a goal, or one of `ends` there, around all others.

        None where there is no way, or the robot is in the goal's cell already: its route leads to its end. Also for
        one `on_its_way` there, if a new route would save too little. robots: ROBOT[B, N]; routes: float32[B, N, R, 2]
        [m]; step: the world's env step.
        """
        r = robots[world, me]
        pose = np.array([r["motion"]["x"], r["motion"]["y"]])
        row, column = self._book.grid.standing(pose).tolist()
        if (row, column) == goal:
            return None
        if self._passing.known_at[world] != step:
            users = RoadUsers(robots, routes, self._persons, self._person_on)
            keep_all_up(self._passing, world, step, users, self._site)
        field, box = self._fields.around((row, column), goal)
        look = ReplanQuery(
            self._passing, self._asked, robots[world], self._fields.steps, self._prices, self._site.size, world, me,
            row, column, field, box.top, box.left, self._hairpin, UNIT * HORIZON,
        )  # fmt: skip
        saving = self._saving if on_its_way else -1
        runs_out = on_its_way and bool(runs_out_of(r, self._laid[world, me]))
        drawn_from = f"{step} {me} {row} {column} {goal}".encode()
        seed = 1 + int.from_bytes(hashlib.blake2b(drawn_from, digest_size=7).digest(), "little")
        count = FINDERS[self.finder][0](look, self._cells[world, me], saving, runs_out, seed, self._room)
        return self._book.along(self._room.path[:count].astype(np.int32), pose, self._reach, ends) if count else None

    def towards(self, cell: Cell, goal: Cell) -> NDArray[np.float32] | None:
        """Return the direction (x, y) of a cheapest way from a cell to a goal; None where there is none."""
        field, box = self._fields.around(cell, goal)
        row, column = cell
        for move in np.flatnonzero(self._fields.steps[row, column]).tolist():
            d_row, d_column = MOVES[move].tolist()
            there = to_go(field, box.top, box.left, row + d_row, column + d_column)
            if there + int(self._fields.steps[row, column, move]) == to_go(field, box.top, box.left, row, column):
                return np.array([d_column, -d_row], np.float32)
        return None
