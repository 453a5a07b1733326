"""Live routes: robots are routed anew on their way, around others that stand and away from where others are going.

Every few seconds of its world's clock a robot looks for a better route from where it is (with routes "barred", as in
trainings, only if its own leads through a cell in or beside which another has not moved a metre for some seconds), at
prices:

- entering the cell of a robot or a person that stands, or one beside it, costs, the more the longer one stands
  oneself;
- a move against one of another's route ahead costs, so that streams part, and the more in an aisle of one cell, where
  the two could not pass (traffic/conflicts.py prices expected conflicts of whole routes; here the routes are on their
  way, and only the opposing moves of the next metres count);
- entering a cell of another's route ahead costs if both will be there at about the same time, so that robots spread
  over the floor before they crowd: it costs the most where both are as far from that cell;
- entering a cell on which others have waited of late costs, for one may have to wait there too: so robots find their
  ways round where the floor is crowded, while there is room elsewhere;
- beginning with a turn costs, the more in an aisle of one cell, where a robot must back out to turn round; turning
  back sharply later on costs as well, or one would go a cell ahead to turn for nothing.

A new route on the way must save some cells at these prices, or the old one is kept: a change of route often begins with
a manoeuvre, in everybody's way. What was tried, of these prices and of others: docs/measured/trials.md.

Who stands and passes where is kept in a table (passing.py), made into prices where a search asks for them (prices.py);
ways.py searches. Robots look one after another, spread over the period by their index, so two that meet do not both
turn away at once, and no step does the work of all. Nothing is drawn by chance: a world's routes depend on its own
robots alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import inline, kernel, part
from warehouse_env.maps.grid_map import MOVES, Cell
from warehouse_env.planning.cost_to_go import UNIT, UNREACHABLE, Box, CostToGo, to_go
from warehouse_env.portable import Portable
from warehouse_env.routes.book import Route, RouteBook
from warehouse_env.routes.goals import Pose
from warehouse_env.simulation.traffic.ants import Ants
from warehouse_env.simulation.traffic.passing import (
    NOTHING,
    ahead_of,
    cell_of,
    forget_route,
    keep_all_up,
    keep_up,
    make_passing,
    note_waiting,
)
from warehouse_env.simulation.traffic.prices import Look, make_asked, prices_for
from warehouse_env.simulation.traffic.ways import Finder, Search

FINDERS: dict[str, type[Search | Ants]] = {
    "pf_aco": Ants,
    "astar_turns": Search,
}  # of live routes, by the name of their planner
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
_EDGE = 24  # [cells] from the edge of a field at which a robot that was led astray gets another


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


@part
def runs_out_of(r, laid):
    """Whether a robot comes near the end of what is laid of its route, which is `laid` [m] long."""
    return r["position"] + np.float32(_NEAR) > laid and laid < (r["points"] - 1) * r["spacing"]


@inline
def _is_barred(passing, b, me, r, route, look_ahead, size, rows, columns):
    """Whether a robot's route leads within look_ahead [m] through a cell in or beside which another stands."""
    if r["points"] < 2:
        return False
    first = ahead_of(r)
    last = min(r["points"] - 1, first + int(look_ahead / np.float64(r["spacing"])))
    own = passing.stands_on[b, me]  # nobody bars his own way
    for k in range(first, last + 1):
        row, column = cell_of(route[k, 0], route[k, 1], size, rows, columns)
        cell = row * columns + column
        others = passing.standing[b, cell, 0] + passing.standing[b, cell, 1]
        if own != NOTHING and max(abs(own // columns - row), abs(own % columns - column)) <= 1 + passing.spread:
            others -= 1
        if others > 0:
            return True
    return False


@kernel
def keep_barred(
    passing, robots, persons, person_on, routes, laid, steps, stood_for, look_ahead, behind, size, rows, columns, looks,
):  # fmt: skip
    """Let only those look whose way is barred, or runs out; return how many.

    robots: ROBOT[B, N]; persons: PERSON[B, M]; routes: float32[B, N, R, 2] [m]; laid: float32[B, N] [m]; steps:
    int64[B]; looks: bool[B, N]; all else: keep_all_up.
    """
    found = 0
    for b in range(robots.shape[0]):
        for i in range(robots.shape[1]):
            if looks[b, i]:
                keep_all_up(
                    passing, b, steps[b], robots[b], persons[b], person_on, routes[b],
                    stood_for, behind, size, rows, columns,
                )  # fmt: skip
                looks[b, i] = runs_out_of(robots[b, i], laid[b, i]) or _is_barred(
                    passing, b, i, robots[b, i], routes[b, i], look_ahead, size, rows, columns
                )
                found += looks[b, i]
    return found


def live_planner(config: EnvConfig) -> Any:
    """Return the planner of live routes: the config's own if it makes any, else astar_turns."""
    from warehouse_env.planning import make_planner

    planner = make_planner(config.planner)
    return planner if planner.name in FINDERS else make_planner("astar_turns")


class LiveRoutes(Portable):
    """Makes routes while robots drive: `watch` says who looks for a better one, `route` makes it from its pose."""

    bound = ("_fields", "_asked")

    def __init__(self, config: EnvConfig, book: RouteBook, persons: NDArray[Any]) -> None:
        """Make the live routes of a configuration; persons: PERSON[B, M]."""
        self._persons, worlds = persons, len(persons)
        self._person_on = np.full(persons.shape, NOTHING, np.int32)  # see keep_all_up
        grid = book.grid
        planner = live_planner(config)
        self.finder: Finder = FINDERS[planner.name](grid.shape)
        self.plans_first = planner.name == config.planner.partition(":")[0]  # not only on the way
        self._gentleness = planner.gentleness
        self._book = book
        seconds = config.action_repeat * config.time_step
        self._every, self._only_barred = max(1, round(EVERY / seconds)), config.traffic_spec.routes == "barred"
        behind = np.array([robot.rear_reach - 0.5 * robot.length for robot in config.robots], np.float32)
        self._floor = STOOD_FOR, behind, np.float32(grid.cell_size)
        robot, size = config.widest_body, config.widest_body.longer / grid.cell_size  # of bodies, in cells
        spread = int(0.5 * (robot.length + robot.width) / grid.cell_size)
        self._prices = prices_for(size, spread)
        self._costs, self._saving = (
            (round(UNIT * (getattr(planner, "hairpin", 0.0) or HAIRPIN * size)), UNIT * HORIZON),
            round(UNIT * SAVING),
        )
        self._passing = make_passing(worlds, config.num_agents, grid.occupied.size, SLOTS, spread)
        self._laid = np.full((worlds, config.num_agents), np.inf, np.float32)  # [m] of routes that are drivable
        fastest = max(max(kind.max_speed, -kind.min_speed) for kind in config.kinds)
        self._reach = LAID if EVERY * fastest < _NEAR / 2 else np.inf
        self._cells: dict[tuple[int, int], NDArray[np.int32]] = {}  # [L, 2], those that a robot's route was made of
        self._boxes: dict[tuple[int, int], tuple[Cell, Box]] = {}  # of the field that each robot goes by, and its goal
        self._bind()

    def _bind(self) -> None:
        self._fields, self._asked = (
            CostToGo(self._book.grid, self._gentleness),
            make_asked(self._book.grid.occupied.size),
        )

    def begin(self, world: int) -> None:
        """Forget all that is known of a world: its robots begin anew."""
        passing = self._passing
        passing.first[world] = passing.stands_on[world] = passing.known_at[world] = passing.cell[world] = NOTHING
        self._person_on[world] = NOTHING
        passing.low[world] = passing.high[world] = passing.standing[world] = 0
        passing.waited[world] = passing.waited_in[world] = passing.period[world] = 0
        self._laid[world] = np.inf
        self.finder.begin(world)
        for robot in range(passing.low.shape[1]):
            self._cells[world, robot] = _NO_CELLS

    def give_up(self, world: int, robot: int) -> None:
        """Forget a robot's route, for it gets another."""
        forget_route(self._passing, world, robot)

    def take_up(
        self, robots: NDArray[Any], routes: NDArray[np.float32], world: int, robot: int,
        cells: NDArray[np.int32], laid: float,
    ) -> None:  # fmt: skip
        """List the new route of a robot for those who look after it, and keep the cells that it was made of.

        robots: ROBOT[B, N]; routes: float32[B, N, R, 2] [m]; cells: int32[L, 2]; laid [m]: how much is drivable.
        """
        self._cells[world, robot] = cells
        self._laid[world, robot] = laid
        stood_for, behind, size = self._floor
        keep_up(
            self._passing, world, robot, robots[world, robot], routes[world, robot], stood_for, behind[robot], size,
            *self._book.grid.shape,
        )  # fmt: skip

    def watch(self, robots: NDArray[Any], routes: NDArray[np.float32], steps: NDArray[np.int64]) -> list[list[int]]:
        """Return [world, robot] of those who look for a better route after this step. robots: ROBOT[B, N]."""
        looks = np.empty(robots.shape, np.bool_)
        if not find_due(robots, steps, self._every, looks):
            return []
        stood_for, behind, size = self._floor
        note_waiting(self._passing, robots, looks, steps, self._every, behind, size, *self._book.grid.shape)
        floor = (stood_for, LOOK_AHEAD, behind, size, *self._book.grid.shape)
        if self._only_barred and not keep_barred(
            self._passing, robots, self._persons, self._person_on, routes, self._laid, steps, *floor, looks
        ):
            return []
        found: list[list[int]] = np.argwhere(looks).tolist()
        return found

    def route(
        self, robots: NDArray[Any], routes: NDArray[np.float32], world: int, me: int, step: int, goal: Cell,
        on_its_way: bool = False, ends: tuple[Pose, ...] = (),
    ) -> Route | None:  # fmt: skip
        """Return a route from where robot `me` of ROBOT[N] is to a goal, or one of `ends` there, around all others.

        None where there is no way, or the robot is in the goal's cell already: its route leads to its end. Also for
        one `on_its_way` there, if a new route would save too little. step: the world's env step.
        """
        r = robots[me]
        pose = np.array([r["x"], r["y"]])
        row, column = self._book.grid.standing(pose).tolist()
        if (row, column) == goal:
            return None
        stood_for, behind, size = self._floor
        if self._passing.known_at[world] != step:
            floor = stood_for, behind, size, *self._book.grid.shape
            keep_all_up(self._passing, world, step, robots, self._persons[world], self._person_on, routes, *floor)
        field, box = self._field(world, me, (row, column), goal)
        look = Look(
            self._passing, self._asked, robots, self._fields.steps, self._prices, size, world, me, row, column,
            field, box.top, box.left, *self._costs,
        )  # fmt: skip
        saving = self._saving if on_its_way else -1
        runs_out = on_its_way and bool(runs_out_of(r, self._laid[world, me]))
        cells = self.finder.find(look, self._cells[world, me], saving, runs_out, goal, step)
        return self._book.along(cells, pose, self._reach, ends) if len(cells) else None

    def towards(self, world: int, robot: int, cell: Cell, goal: Cell) -> NDArray[np.float32] | None:
        """Return the direction (x, y) of a cheapest way from a cell to a goal; None where there is none."""
        field, box = self._field(world, robot, cell, goal)
        row, column = cell
        for move in np.flatnonzero(self._fields.steps[row, column]).tolist():
            d_row, d_column = MOVES[move].tolist()
            there = to_go(field, box.top, box.left, row + d_row, column + d_column)
            if there + int(self._fields.steps[row, column, move]) == to_go(field, box.top, box.left, row, column):
                return np.array([d_column, -d_row], np.float32)
        return None

    def _field(self, world: int, me: int, cell: Cell, goal: Cell) -> tuple[NDArray[np.int32], Box]:
        """Return the cost-to-go of a robot's goal around it, and where that is."""
        known, box = self._boxes.get((world, me), (None, None))
        if box is None or known != goal or self._is_at_edge(cell, box):
            box = self._fields.box(cell, goal)
            field = self._fields.field(goal, box)
            if field[cell[0] - box.top, cell[1] - box.left] == UNREACHABLE:
                box = self._fields.whole()
            self._boxes[world, me] = goal, box
        return self._fields.field(goal, box), box

    def _is_at_edge(self, cell: Cell, box: Box) -> bool:
        """Whether a cell is so near the edge of a box, and that not the floor's, that ways may lead out of it."""
        (row, column), (rows, columns) = cell, self._book.grid.shape
        return (
            (box.top > 0 and row - box.top < _EDGE) or (box.bottom < rows and box.bottom - row <= _EDGE)
            or (box.left > 0 and column - box.left < _EDGE) or (box.right < columns and box.right - column <= _EDGE)
        )  # fmt: skip
