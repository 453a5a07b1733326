"""Give robots tasks and routes: at the reset, on arrival, and where another robot bars their way."""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import warehouse_env.simulation.state as state
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.kernel import compiled_for
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.portable import Portable
from warehouse_env.routes.book import RouteBook
from warehouse_env.routes.goals import Goal, Pose, facing
from warehouse_env.routes.route_table import Lines, Route, RouteTable
from warehouse_env.simulation.draws import Draws
from warehouse_env.simulation.physics.floor import Floor
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.tasks import beginning, giving
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.simulation.tasks.goals import GoalState, endpoints_of
from warehouse_env.simulation.tasks.orders import Order
from warehouse_env.simulation.tasks.placement import Limits, stand, stand_facing
from warehouse_env.simulation.tasks.sampled import TASKS, SampledTasks
from warehouse_env.simulation.tasks.shifts import Shifts, check_given
from warehouse_env.simulation.tasks.tasks import (
    Arrival,
    Tasks,
    book_arrival,
    pass_by,
    set_out,
    take_end,
    take_goal,
    take_route,
)  # fmt: skip
from warehouse_env.simulation.traffic.live import LiveRoutes
from warehouse_env.simulation.traffic.live_search import LiveRoom
from warehouse_env.simulation.traffic.off_route import far_off, find_off_route
from warehouse_env.threads import get_num_threads, side_by_side

# [m], of the default body, before the end of a route at which a robot seeks the manoeuvre to its goal's pose
JOIN = 3.0
_ALONG_AISLES = np.eye(2, dtype=np.float32)  # a robot that fits on a cell fits in one of these directions
ROUTE_BLOCK = 64  # way-points by which the routes' array grows


def width_of(points: int) -> int:
    """Return the width of an array of routes with so many way-points: whole blocks."""
    return math.ceil(points / ROUTE_BLOCK) * ROUTE_BLOCK


def no_room(robots: int, placed: int, grid: GridMap) -> ConfigError:
    """Return the error of a floor on which not all robots find a start."""
    return ConfigError(
        f"num_agents={robots} do not fit on map {grid.name!r}: only {placed} found a start that touches nothing; "
        "use fewer robots or a larger map"
    )


class Dispatcher(Portable):
    """Gives the robots of all worlds their tasks and routes.

    `robots` ROBOT[B, N], `persons` PERSON[B, M] and `limits` (placement.py) are the Simulator's. Of `routes` float32[B,
    N, R, 2] [m] the first state.route_points of each robot are valid; a longer route puts a larger array in its place.
    `book` may be replaced by another of the same floor.
    """

    bound = ("_compiled", "_task_floor", "_room")

    def __init__(
        self, config: EnvConfig, book: RouteBook, robots: NDArray[np.void], persons: NDArray[np.void],
        limits: Limits, draws: Draws, orders: Sequence[Order] | None = None,
    ) -> None:  # fmt: skip
        """Make each world's tasks; ConfigError where they, or live routes, cannot be had.

        orders: instead of those that the config names.
        """
        self.book, self.robots, self._draws = book, robots, draws
        self.routes = np.zeros((*robots.shape, ROUTE_BLOCK, 2), dtype=np.float32)
        self._config, self._limits, self._kind_of = config, limits, config.kind_of
        self._astray, self.far = np.empty(robots.shape, dtype=np.bool_), far_off(config, book.grid.cell_size)
        endpoints, each = endpoints_of(book.grid), (len(robots), config.num_agents)
        self.live = LiveRoutes(config, book, persons, endpoints.number) if config.traffic_spec.routes else None
        self.all_look = config.traffic_spec.routes is True  # so some robot's route changes in almost every step
        named = TASKS.get(config.tasks)
        tasks = named if isinstance(named, type) and issubclass(named, Tasks) else SampledTasks
        self.goals = GoalState.of(len(robots), config.num_agents, len(book.grid.endpoints[2]))
        self.tasks = [tasks(book.grid, config, self.goals, world) for world in range(len(robots))]
        check_given(orders, config)
        self.shifts = Shifts(config, book.grid, self.tasks, limits, orders) if config.works else None
        self._told: dict[tuple[int, int], Goal] = {}  # points and poses that an assignment gives, up to the arrival
        self._rules = giving.rules_of(config, self._join(0), self.far)
        lifelong, alike = config.tasks == "lifelong", config.arrival != "pose" or not config.fleet
        # kernels give goals and routes, those of a table or live ones; else Python does
        self.by_table = lifelong and alike and self.live is None
        plain = lifelong and config.arrival != "pose" and not config.works
        self.by_live = plain and self.live is not None and self.live.by_kernel
        self.begins_by_kernel = self.by_table or (self.by_live and self.live is not None and self.live.plans_first)
        self.wanted, self.booked = np.zeros(each, np.int64), np.zeros((*each, 2))  # see giving.TaskArrays
        self.status, self._left = np.zeros(len(robots), np.int32), np.full(len(robots), -1)
        self._bind()

    def _bind(self) -> None:
        self._compiled: dict[Callable[..., Any], Callable[..., Any]] = {}  # kernels, once a step or a reset calls them
        self._task_floor = giving.floor_of(self.book.grid)
        self._room = self.make_scratch()

    def make_scratch(self) -> tuple[tuple[NDArray[np.int32], ...], LiveRoom | None]:
        """Return scratch for a thread that places robots: for the orders of places, and for live routes."""
        endpoints = self._task_floor.endpoints
        orders = np.empty(len(endpoints.cells), np.int32), np.empty(len(endpoints.elsewhere), np.int32)
        return orders, self.live.room() if self.live is not None and self.by_live else None

    def _call(self, kernel: Callable[..., Any], *arguments: Any) -> Any:
        """Call a kernel; the types of its arguments never change."""
        if kernel not in self._compiled:
            self._compiled[kernel] = compiled_for(kernel, *arguments)
        return self._compiled[kernel](*arguments)

    def begin(self, world: int, entropy: list[int] | None, assignment: Assignment | None, floor: Floor) -> None:
        """Stand the robots of a world on the floor with their first tasks, by chance or as the assignment says.

        entropy: what the generator of the world's shift is seeded with; None: it goes on.
        """
        self.forget([world])
        for robot in range(self.robots.shape[1]):
            self._told.pop((world, robot), None)
        if self.shifts is not None:
            self.shifts.begin(world, entropy, self._draws.keys[world])
        if assignment is not None:
            self._assign(world, assignment, floor)
        elif self.begins_by_kernel:
            self.begin_by_kernel([world], floor)
        else:
            self._place_all(world, floor, idle=self._config.orders is not None)
        if self.shifts is not None:
            self.shifts.begin_at(world, self.robots[world])
            self._go_on(self.shifts, world, 0)

    def _assign(self, world: int, assignment: Assignment, floor: Floor) -> None:
        """Place the robots of a world at the given poses with the given goals."""
        starts = [(row, column) for row, column in self.book.grid.standing(assignment.pose[:, :2]).tolist()]
        goals = assignment.goals(self.book.grid)
        self.tasks[world].assign(starts, [goal.cell for goal in goals])
        for robot, (start, goal) in enumerate(zip(starts, goals, strict=True)):
            stand(self.robots[world], robot, assignment.pose[robot], self._limits, floor)
            heading = float(assignment.pose[robot, 2])
            if goal.poses:
                self._told[world, robot] = goal
            self.give_task(world, robot, goal.cell, self._first_route(world, robot, start, goal.cell, heading))

    def _ends(self, world: int, robot: int, goal: Cell) -> tuple[Pose, ...]:
        """Return the poses where a robot's routes to a goal may end; none: at the cell's centre."""
        told = self._told.get((world, robot))
        if told is not None and told.cell == goal and told.poses:
            return told.poses if self._config.arrival == "pose" else tuple((x, y, math.nan) for x, y, _ in told.poses)
        if self._config.arrival != "pose" and not self._parks_along(world, robot):
            return ()
        return self.book.ends(goal, self._config.kinds[self._kind_of[robot]])

    def _parks_along(self, world: int, robot: int) -> bool:
        """Whether a robot is to stand along the wall, so that it bars no lane. Raw actions cannot aim that well."""
        return self.shifts is not None and self.shifts[world].stands_aside(robot) and self._config.action_type != "raw"

    @property
    def route_table(self) -> RouteTable:
        """The table of the routes that `arrays` refers to."""
        posed = self._config.arrival == "pose"
        return self.book.table(self._config.robot if posed else None)

    def arrays(self, lines: Lines) -> giving.TaskArrays:
        """Return what the kernels read and write that give goals and routes."""
        own = self.robots, self.routes, self._draws.keys, self.goals, self.wanted, self.booked
        return giving.TaskArrays(*own, lines, self._task_floor, self._rules)

    def begin_by_kernel(self, worlds: Sequence[int], floor: Floor) -> None:
        """Place the robots of forgotten worlds, in ascending order, with routes of the table, or with live ones.

        A world that first wants a route of the table is begun again. If there is no room for a live route, Python
        places one world, which makes room for the others.
        """
        table = self.route_table
        table.trim()
        while worlds:
            self.make_room(table.longest)
            self._place_by_kernel(worlds, floor)
            worlds = [world for world in worlds if self.status[world] == beginning.TO_PLACE]
            if self.by_table:
                table.fill(self.wanted[worlds].ravel())
            elif worlds:
                self.forget(worlds)
                self._place_all(worlds[0], floor, idle=False)
                worlds = worlds[1:]

    def forget(self, worlds: Sequence[int]) -> None:
        """Take all robots of worlds off the floor."""
        for world in worlds:
            self.tasks[world].reset(self._draws.keys[world])
            self.robots[world] = state.fresh_robot()
            if self.live is not None:
                self.live.begin(world)

    def _place_by_kernel(self, worlds: Sequence[int], floor: Floor) -> None:
        """Let the kernel place the robots of worlds, on as many threads as allowed; `status` tells what it did."""
        status, arrays, (params, kinds) = self.status, self.arrays(self.route_table.lines), self._limits
        status[worlds], threads = beginning.TO_PLACE, min(get_num_threads(), len(worlds))
        live = None if self.live is None else self.live.arrays

        def place(first: int, last: int) -> None:
            orders, room = self._room if threads == 1 else self.make_scratch()
            routes = None if live is None else (live, room)
            self._call(beginning.place, first, last + 1, status, orders, (params[0], kinds, floor), arrays, routes)

        side_by_side(place, [(int(part[0]), int(part[-1])) for part in np.array_split(worlds, threads)])
        worst = int(status[worlds].min())
        if worst < 0:
            raise no_room(self.robots.shape[1], -1 - worst, self.book.grid)

    def _place_all(self, world: int, floor: Floor, idle: bool) -> None:
        """Give every robot of a world a start, a goal and a route; idle: it stands, and its goal is where."""
        key, tasks, robots = self._draws.keys[world], self.tasks[world], self.robots.shape[1]
        places = tasks.starts(key)
        cells, spare = places[:robots], places[robots:]
        goals = cells if idle else tasks.first_goals(cells, key)
        if self.live is None or not self.live.plans_first:
            ends = [self._ends(world, robot, goal) for robot, goal in enumerate(goals)]
            self.book.prepare(list(zip(cells, goals, ends, strict=True)))
        elsewhere: list[Cell] | None = None
        for robot in range(robots):
            if robot < len(cells) and self._place(world, robot, cells[robot], goals[robot], floor):
                continue
            if self._place_on_one(world, robot, spare, idle, floor):
                continue
            elsewhere = tasks.elsewhere(key) if elsewhere is None else elsewhere
            if not self._place_on_one(world, robot, elsewhere, idle, floor):
                raise no_room(robots, robot, self.book.grid)

    def _place_on_one(self, world: int, robot: int, cells: list[Cell], idle: bool, floor: Floor) -> bool:
        """Put a robot on the first of some cells on which it touches nothing; take all that were tried off the list."""
        tasks, key = self.tasks[world], self._draws.keys[world]
        while cells:
            cell = cells.pop(0)
            goal = cell if idle else tasks.next_goal(robot, cell, key)
            # asked before a route is planned, which takes far longer, for most of these cells are taken
            fits = (self._stand(world, robot, cell, way, floor) for way in _ALONG_AISLES)
            if any(fits) and self._place(world, robot, cell, goal, floor):
                return True
        return False

    def _place(self, world: int, robot: int, cell: Cell, goal: Cell, floor: Floor) -> bool:
        """Put a robot on a cell, facing along its route; False if it touches something there."""
        direction = None
        if self.live is not None and self.live.plans_first:
            direction = self.live.towards(cell, goal)
        if direction is None:
            line = self.book.route(cell, goal, None, self._ends(world, robot, goal)).line
            direction = line[min(2, len(line) - 1)] - line[0]
        if not self._stand(world, robot, cell, direction, floor):
            return False
        self.give_task(world, robot, goal, self._first_route(world, robot, cell, goal))
        return True

    def _stand(self, world: int, robot: int, cell: Cell, direction: NDArray[np.float32], floor: Floor) -> bool:
        """Put a robot on a cell, facing `direction` as nearly as fits; False if nothing fits."""
        (p, kinds), start = self._limits, (*self.book.grid.centre(cell).tolist(), *direction.tolist())
        return bool(stand_facing(self.robots[world], robot, start, p[0], kinds, floor))

    def _first_route(self, world: int, robot: int, cell: Cell, goal: Cell, heading: float | None = None) -> Route:
        """Return the route that a robot which stands on a cell begins with."""
        live = self._live_route(world, robot, goal, 0) if self.live is not None and self.live.plans_first else None
        return live or self.book.route(cell, goal, heading, self._ends(world, robot, goal))

    def give_task(self, world: int, robot: int, goal: Cell, route: Route) -> None:
        """Give a robot a goal and its first route there."""
        self.give_route(world, robot, route)
        take_goal(self.robots, self.routes, world, robot, *goal)

    def give_route(self, world: int, robot: int, route: Route) -> None:
        """Give a robot another route to its goal.

        Where a line bends sharply, as at a pose beside the lane, its points are nearer to each other: not its spacing.
        """
        points = route.line
        self.make_room(len(points))
        take_route(self.robots, self.routes, world, robot, points, self._rules.heading)
        if route.end is not None:
            take_end(self.robots, world, robot, *route.end, route.either, self._join(robot))
        if self.live is not None:
            self.live.take_up(self.robots, self.routes, world, robot, route.cells, route.reach)

    def _join(self, robot: int) -> float:
        params, kinds = self._limits
        return JOIN * float(kind_of(robot, params[0], kinds)["length_scale"])

    def make_room(self, points: int) -> None:
        """Take a larger array of routes if theirs have more way-points than it has."""
        if points > self.routes.shape[2]:
            grown = np.zeros((*self.robots.shape, width_of(points), 2), dtype=np.float32)
            grown[:, :, : self.routes.shape[2]] = self.routes
            self.routes = grown

    def arrive(self, steps: NDArray[np.int64], arrived: Sequence[Sequence[int]]) -> list[Arrival]:
        """Book the arrivals and return them, and give lifelong robots their next task.

        steps [B]: since the resets; arrived: (world, robot), in ascending order.

        Where robots work on a shift, an arrival at a place that is no stop of its work is none.
        """
        if self.live is not None:
            self.live.arrays.changed[:] = False
        if self.by_live and not self._told:
            return self._arrive_by_kernel(steps, arrived)
        config, arrivals = self._config, []
        for world, robot in arrived:
            r, step = self.robots[world, robot], int(steps[world])
            seconds = step * config.action_repeat * config.time_step
            if self.shifts is not None:
                r["task"]["alive"] = 0
                if not self.shifts[world].arrive(robot):
                    pass_by(self.robots, world, robot)
                    continue
            lengths = book_arrival(self.robots, world, robot, seconds, 2 * step > config.max_steps)
            arrivals.append(Arrival(world, robot, *lengths))
            if self.shifts is None and config.tasks != "one_shot" and r["task"]["alive"]:
                self._told.pop((world, robot), None)
                start = state.goal_of(r)
                goal = self.tasks[world].next_goal(robot, start, self._draws.keys[world])
                self.give_task(world, robot, goal, self._route(world, robot, start, goal, step))
        return arrivals

    def _arrive_by_kernel(self, steps: NDArray[np.int64], arrived: Sequence[Sequence[int]]) -> list[Arrival]:
        """Do as `arrive` does for lifelong tasks with live routes to the centres of cells."""
        assert self.live is not None
        marks, places = np.zeros(self.robots.shape, np.bool_), np.array(arrived, np.int64).reshape(-1, 2)
        marks[places[:, 0], places[:, 1]] = True
        self.live.arrays.changed[marks] = True

        def set_off(world: int, robot: int) -> None:
            columns, goal = self.book.grid.shape[1], state.goal_of(self.robots[world, robot])
            start = divmod(int(self.wanted[world, robot]), columns)
            self.wanted[world, robot] = 0
            self.give_task(world, robot, goal, self._route(world, robot, start, goal, int(steps[world])))

        self._give_live(giving.arrive_live, steps, marks, set_off)
        booked = self.booked[places[:, 0], places[:, 1]].tolist()
        return [Arrival(*place, *lengths) for place, lengths in zip(places.tolist(), booked, strict=True)]

    def _give_live(
        self, kernel: Callable[..., None], steps: NDArray[np.int64], marks: NDArray[np.bool_],
        by_hand: Callable[[int, int], None],
    ) -> None:  # fmt: skip
        """Let a kernel of giving.py serve the robots in `marks`, and `by_hand` those that it leaves."""
        live, lines = self.live, self.route_table.lines
        while live is not None and marks.any():
            self._call(kernel, steps, marks, self._left, self.arrays(lines), (live.arrays, self._room[1]))
            for world in np.flatnonzero(self._left >= 0).tolist():
                by_hand(world, int(self._left[world]))
                self._left[world] = -1

    def work_on(self, steps: NDArray[np.int64]) -> list[int]:
        """Give robots the goals that their shifts send them to; return the worlds in which a goal changed."""
        if self.shifts is None:
            return []
        return [world for world, step in enumerate(steps.tolist()) if self._go_on(self.shifts, world, step)]

    def _go_on(self, shifts: Shifts, world: int, step: int) -> bool:
        """Give a world's robots the goals that its shift has for them now; return whether it has any."""
        goals = shifts.go_on(world, self.robots[world])
        for robot, goal in goals.items():
            self._told.pop((world, robot), None)
            set_out(self.robots, world, robot, *goal)
            self.give_task(world, robot, goal, self._route_from_here(world, robot, step))
        return bool(goals)

    def work_row(self, world: int) -> dict[str, float]:
        """Return the metrics of a world's shift (Shift.row); none where nobody works one."""
        return {} if self.shifts is None else self.shifts[world].row(self.robots[world])

    def reroute(self, steps: NDArray[np.int64]) -> list[int]:
        """Reroute robots that are off their routes or find a better one; return the worlds in which a route changed."""
        worlds = []
        if self._call(find_off_route, self.robots, self.routes, self.far, self._astray):
            worlds = self.return_to_route(steps, np.argwhere(self._astray).tolist())
        if self.live is None:
            return worlds

        def look(world: int, robot: int) -> None:
            goal = state.goal_of(self.robots[world, robot])
            route = self._live_route(world, robot, goal, int(steps[world]), on_its_way=True)
            if route is not None:
                self._give_another(world, robot, route)

        looks = self.live.watch(self.robots, self.routes, steps)
        if self.by_live and not self._told:
            self._give_live(giving.reroute_live, steps, looks, look)
        else:
            for place in np.argwhere(looks).tolist():
                look(*place)
        changed: list[int] = np.flatnonzero(self.live.arrays.changed.any(axis=1)).tolist()
        return changed

    def return_to_route(self, steps: NDArray[np.int64], off: Iterable[Sequence[int]]) -> list[int]:
        """Give robots (world, robot) routes from where they are; return their worlds."""
        worlds = []
        for world, robot in off:
            self._give_another(world, robot, self._route_from_here(world, robot, int(steps[world])))
            worlds.append(world)
        return worlds

    def _route_from_here(self, world: int, robot: int, step: int) -> Route:
        """Return a route to a robot's goal from the cell in which it is, around others if they count."""
        r = self.robots[world, robot]
        goal, pose = state.goal_of(r), np.array([r["motion"]["x"], r["motion"]["y"]])
        row, column = self.book.grid.standing(pose).tolist()
        if (row, column) == goal:
            cells, ends = np.array([goal], dtype=np.int32), self._ends(world, robot, goal)
            end = facing(ends, cells) if ends else None
            there = self.book.grid.centre(cells[0]) if end is None else np.array(end[:2])
            return Route(cells, np.array([pose, there], dtype=np.float32), end=end, either=len(ends) > 1)
        return self._route(world, robot, (row, column), goal, step)

    def _give_another(self, world: int, robot: int, route: Route) -> None:
        """Replace a robot's route on its way; the time without a metre of progress continues."""
        self.give_route(world, robot, route)
        r = self.robots[world, robot]
        r["clocks"]["milestone"] = 0.0
        r["totals"]["reroutes"] += 1

    def _route(self, world: int, robot: int, start: Cell, goal: Cell, step: int) -> Route:
        """Return a live route if there is one, else that from the cell in which a robot is."""
        heading, ends = float(self.robots[world, robot]["motion"]["heading"]), self._ends(world, robot, goal)
        return self._live_route(world, robot, goal, step) or self.book.route(start, goal, heading, ends)

    def _live_route(self, world: int, robot: int, goal: Cell, step: int, on_its_way: bool = False) -> Route | None:
        """Return a route from where a robot is, around all others; None if live routes are off or find none."""
        if self.live is None:
            return None
        ends = self._ends(world, robot, goal)
        return self.live.route(self.robots, self.routes, world, robot, step, goal, on_its_way, ends)
