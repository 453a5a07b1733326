"""Choose the robots' goals: endpoints, distinct at any moment."""

import math
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np

from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.portable import Portable
from warehouse_env.simulation.draws import ELSEWHERE, START, Key, shuffle
from warehouse_env.simulation.driver.line import forget_grants
from warehouse_env.simulation.tasks.goals import GoalState, endpoints_of, forget_goals, next_goal


class Arrival(NamedTuple):
    """A task that a robot finished with the last step."""

    world: int
    robot: int
    driven: float  # [m], since the robot's last goal or the reset
    planned: float  # [m]


@kernel
def book_arrival(robots, world, robot, seconds, late):
    """Count an arrival in a robot's record, `seconds` after the reset; late: in the second half of the episode.

    Returns the metres driven since its last goal or the reset, and the metres planned.
    """
    r = robots[world, robot]
    totals = r["totals"]
    driven, planned = totals["distance"] - totals["distance_at_goal"], totals["task_length"]
    totals["goals"] += 1
    totals["late_goals"] += 1 if late else 0
    totals["longest_age"] = max(totals["longest_age"], r["task"]["age"])
    r["task"]["age"] = 0
    totals["planned"] += planned
    totals["driven_to_goals"] += driven
    totals["distance_at_goal"] = totals["distance"]
    totals["finish_time"] = np.float32(seconds)
    return driven, planned


@kernel
def pass_by(robots, world, robot):
    """End a robot's way to a place that is no goal of its work: neither it nor the metres driven there count."""
    r = robots[world, robot]
    totals = r["totals"]
    r["events"]["arrived"] = 0
    totals["longest_age"] = max(totals["longest_age"], r["task"]["age"])
    r["task"]["age"] = 0
    totals["distance_at_goal"] = totals["distance"]


@kernel
def set_out(robots, world, robot, row, column):
    """Send a robot that stood, or was on its way elsewhere, to the goal's cell; its clocks restart."""
    r = robots[world, robot]
    task, clocks = r["task"], r["clocks"]
    if task["alive"] == 0:
        clocks["waiting_time"] = clocks["standing_time"] = r["shield"]["vetoed_time"] = np.float32(0.0)
        clocks["anchor_x"], clocks["anchor_y"] = r["motion"]["x"], r["motion"]["y"]
    task["alive"] = 1
    task["goal_row"], task["goal_col"] = row, column


@kernel
def take_route(robots, routes, world, robot, points, heading):
    """Write way-points float32[R, 2] [m] into routes float32[B, N, R', 2], and that its robot begins them.

    heading: that of a goal that says none.
    """
    spacing = np.float32(0.0)
    for k in range(len(points)):
        routes[world, robot, k, 0], routes[world, robot, k, 1] = points[k, 0], points[k, 1]
        if k > 0:
            dx, dy = np.float64(points[k, 0] - points[k - 1, 0]), np.float64(points[k, 1] - points[k - 1, 1])
            spacing = max(spacing, np.float32(np.sqrt(dx * dx + dy * dy)))  # the same bits on any machine
    r = robots[world, robot]
    on_route, manoeuvre = r["on_route"], r["manoeuvre"]
    on_route["points"] = len(points) if spacing > 0.0 else 1  # it stands at the end already
    on_route["spacing"] = spacing
    on_route["position"] = on_route["lateral"] = on_route["bearing"] = np.float32(0.0)
    manoeuvre["arcs"] = manoeuvre["seeks"] = manoeuvre["docks"] = 0  # of a manoeuvre to the route before
    manoeuvre["search_wait"] = r["traffic"]["side"] = np.float32(0.0)
    forget_grants(r)
    r["task"]["goal_heading"], r["task"]["either"], manoeuvre["join"] = heading, False, np.float32(0.0)


@kernel
def take_end(robots, world, robot, x, y, heading, either, join):
    """Write the pose at which a robot's route ends: its goal, which it seeks from `join` [m] before the end on.

    either: its body may as well stand there the other way round.
    """
    r = robots[world, robot]
    task = r["task"]
    task["goal_x"], task["goal_y"], task["goal_heading"], task["either"] = x, y, heading, either
    r["manoeuvre"]["join"] = np.float32(0.0) if np.isnan(heading) else join


@kernel
def take_goal(robots, routes, world, robot, row, column):
    """Begin the task to the goal's cell, where the robot's route ends."""
    r = robots[world, robot]
    task = r["task"]
    r["clocks"]["milestone"] = r["clocks"]["stalled_time"] = np.float32(0.0)
    last = r["on_route"]["points"] - 1
    r["totals"]["task_length"] = np.float64(last) * np.float64(r["on_route"]["spacing"])
    task["goal_x"], task["goal_y"] = routes[world, robot, last, 0], routes[world, robot, last, 1]
    task["goal_row"], task["goal_col"] = row, column


class Tasks(Portable):
    """The goals of one world's robots. Lifelong robots alternate between a pick face and a station."""

    bound: ClassVar[tuple[str, ...]] = ("_endpoints", "places")

    def __init__(self, grid: GridMap, config: EnvConfig, state: GoalState | None = None, world: int = 0) -> None:
        """Take the row `world` of the state of several worlds, or make one of its own."""
        self._grid, self._world = grid, world
        self._bind()
        robots = config.num_agents
        if robots >= len(self.places) and not (robots == 1 and len(self.places) == 1):
            raise ConfigError(
                f"num_agents={robots} is too many for map {grid.name!r}: it has {len(self.places)} endpoints, and "
                "goals are distinct; use fewer robots or a map with more picks and stations"
            )
        self._state = GoalState.of(1, robots, len(self.places)) if state is None else state

    def _bind(self) -> None:
        """Look up the map's endpoints, which all worlds share."""
        self._endpoints, self.places = endpoints_of(self._grid), self._grid.endpoints[2]

    def reset(self, key: Key) -> None:
        """Forget all goals; each robot's first is a pick face or a station, by chance.

        key: of the world's draws (draws.py).
        """
        forget_goals(self._state, self._world, key)

    def starts(self, key: Key) -> list[Cell]:
        """Return all places in the order in which robots may be stood on them."""
        order = np.empty(len(self.places), np.int32)
        shuffle(key, START, order)
        return [self.places[k] for k in order.tolist()]

    def elsewhere(self, key: Key) -> list[Cell]:
        """Return other cells, in a random order, on which robots start that do not fit on pick faces and stations."""
        cells = self._endpoints.elsewhere
        order = np.empty(len(cells), np.int32)
        shuffle(key, ELSEWHERE, order)
        return [(row, column) for row, column in cells[order].tolist()]

    def first_goals(self, starts: Sequence[Cell], key: Key) -> list[Cell]:
        """Give each robot its first goal."""
        return [self.next_goal(robot, start, key) for robot, start in enumerate(starts)]

    def assign(self, starts: Sequence[Cell], goals: Sequence[Cell]) -> None:
        """Take these as the robots' goals; after a pick face the next is a station, after anything else a pick face.

        starts: where the robots stand, which lifelong tasks ignore.
        """
        state, picks = self._state, set(self._endpoints.kinds[0].tolist())
        numbers = [self._number(goal) for goal in goals]
        state.goal[self._world], state.taken[self._world] = numbers, False
        state.taken[self._world, [number for number in numbers if number >= 0]] = True
        state.next_kind[self._world] = [number in picks for number in numbers]

    def cut_off(self) -> float:
        """Return how many robots others parked at their goals could cut off from theirs; nan where nobody parks."""
        return math.nan

    def next_goal(self, robot: int, at: Cell, key: Key) -> Cell:
        """Give a robot its next goal: neither where it is nor the goal of another robot."""
        number = next_goal(self._state, self._world, robot, self._number(at), key, self._endpoints)
        return at if number < 0 else self.places[number]

    def _number(self, cell: Cell) -> int:
        """Return the number of an endpoint; -1 for another cell."""
        return int(self._endpoints.number[cell])
