"""Kernels that give robots goals and routes: on arrival, off their routes, and where others bar them.

A route that is not in the floor's table yet is `wanted`: the host makes it (RouteTable.fill), and calls again.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import inline, kernel, part, whole
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.standing import standing_cell
from warehouse_env.routes.route_table import Lines, behind_of, key_of, slot_of
from warehouse_env.simulation.tasks.goals import NONE, Endpoints, GoalState, endpoints_of, next_goal
from warehouse_env.simulation.tasks.tasks import book_arrival, take_end, take_goal, take_route
from warehouse_env.simulation.traffic.live_search import find_live, list_route, to_goal
from warehouse_env.simulation.traffic.off_route import is_off_route
from warehouse_env.simulation.traffic.route_occupancy import RoadUsers

# Results of a live query: no route, or no better one; a new route; Python must find it.
NONE_FOUND, GIVEN, LEFT = range(3)


class TaskFloor(NamedTuple):
    """The floor on which goals and routes are given."""

    endpoints: Endpoints
    occupied: NDArray[np.bool_]  # [H, W]
    closed: NDArray[np.bool_]  # [H, W], GridMap.closed
    free: NDArray[np.int64]  # [F, 2], GridMap.free_cells
    size: float  # [m] of a cell


class TaskRules(NamedTuple):
    """What a config says of tasks."""

    heading: np.float32  # [rad] of a goal that says none
    join: np.float32  # [m] before the end of a route from which a robot seeks the manoeuvre to its goal's pose
    far: np.float32  # [m] from which a robot is off its route
    repeat: int  # physics steps in an env step
    time_step: float  # [s]
    max_steps: int
    idle: bool  # robots wait for orders where they start


class TaskArrays(NamedTuple):
    """What the kernels read and write of B worlds."""

    robots: NDArray[np.void]  # ROBOT[B, N]
    routes: NDArray[np.float32]  # [B, N, R, 2] [m]
    keys: NDArray[np.uint64]  # [B, 3], draws.Key
    goals: GoalState
    wanted: NDArray[np.int64]  # [B, N], keys of routes, to the present goal if negative; 0: none
    booked: NDArray[np.float64]  # [B, N, 2] [m], driven and planned, of the robots that arrived in the last step
    lines: Lines
    floor: TaskFloor
    rules: TaskRules


def floor_of(grid: GridMap) -> TaskFloor:
    """Return the kernels' view of a floor."""
    return TaskFloor(endpoints_of(grid), grid.occupied, grid.closed, grid.free_cells, float(grid.cell_size))


def rules_of(config: EnvConfig, join: float, far: np.float32) -> TaskRules:
    """Return the rules of a config."""
    # nan only where headings matter, since it is equal to nothing, not even in a copy of the same robot
    heading = np.float32(0.0 if config.arrival == "pass" else np.nan)
    pace = config.action_repeat, float(config.time_step), config.max_steps
    return TaskRules(heading, np.float32(join), far, *pace, config.orders is not None)


@part
def goal_of(r):
    return r["task"]["goal_row"], r["task"]["goal_col"]


@part
def key_between(start, goal, behind, floor):
    """Return the key of the route between two cells (row, column)."""
    rows, columns = floor.occupied.shape
    first, last = whole(start[0]) * columns + start[1], whole(goal[0]) * columns + goal[1]
    return key_of(first, last, behind, rows * columns)


@part
def slot_in(key, arrays):
    """Return the slot of a route; -1 if it is not in the table, or longer than the robots' arrays of way-points."""
    lines = arrays.lines
    slot = slot_of(key, lines.keys)
    return slot if lines.keys[slot] != 0 and lines.counts[slot] <= arrays.routes.shape[2] else -1


@part
def _take(at, points, slot, arrays):
    """Give robot at[1] of world at[0] way-points as its route, and the pose at which the route in a slot ends."""
    (world, robot), robots, lines, rules = at, arrays.robots, arrays.lines, arrays.rules
    take_route(robots, arrays.routes, world, robot, points, rules.heading)
    end = lines.ends[slot]
    if not np.isnan(end[0]):
        take_end(robots, world, robot, end[0], end[1], end[2], lines.either[slot], rules.join)


@inline
def span_of(slot, lines):
    """Return the way-points of the route in a slot: the first, and the one after the last."""
    return lines.begins[slot], lines.begins[slot] + lines.counts[slot]


@part
def _here(r, floor):
    """Return the cell (row, column) from which a robot plans."""
    motion = r["motion"]
    return standing_cell(np.float64(motion["x"]), np.float64(motion["y"]), floor.occupied, floor.free, floor.size)


@part
def _way(r, here, floor):
    """Return the key of a robot's route from a cell to its goal."""
    goal = goal_of(r)
    behind = behind_of(floor.closed, here[0], here[1], goal[0], goal[1], np.float64(r["motion"]["heading"]))
    if here[0] == goal[0] and here[1] == goal[1]:
        behind = 0
    return key_between(here, goal, behind, floor)


@part
def _book(at, step, arrays):
    """Book a robot's arrival, and draw its next goal; step: the world's env step."""
    (world, robot), rules = at, arrays.rules
    seconds = np.float64(step * rules.repeat) * rules.time_step
    driven, planned = book_arrival(arrays.robots, world, robot, seconds, 2 * step > rules.max_steps)
    arrays.booked[world, robot, 0], arrays.booked[world, robot, 1] = driven, planned
    if arrays.robots[at]["task"]["alive"] != 0:
        draw_goal(at, goal_of(arrays.robots[at]), arrays)


@part
def draw_goal(at, here, arrays):
    """Draw the next goal of a robot in a cell (row, column); where robots wait for orders, it is that cell."""
    (world, robot), endpoints, task = at, arrays.floor.endpoints, arrays.robots[at]["task"]
    number = np.int32(NONE)
    if not arrays.rules.idle:
        number = next_goal(arrays.goals, world, robot, endpoints.number[here], arrays.keys[world], endpoints)
    task["goal_row"], task["goal_col"] = here
    if number != NONE:
        task["goal_row"], task["goal_col"] = endpoints.cells[number, 0], endpoints.cells[number, 1]


@part
def begin_task(at, slot, arrays):
    """Give a robot the route in a slot as the first to its goal."""
    first, end = span_of(slot, arrays.lines)
    _take(at, arrays.lines.points[first:end], slot, arrays)
    row, column = goal_of(arrays.robots[at])
    take_goal(arrays.robots, arrays.routes, at[0], at[1], row, column)


@part
def _reroute(at, slot, arrays):
    """Give a robot the route in a slot to its goal, from where it is; in the goal's cell, straight to its end."""
    r = arrays.robots[at]
    here, goal, points = _here(r, arrays.floor), goal_of(r), arrays.lines.points
    first, end = span_of(slot, arrays.lines)
    if here[0] == goal[0] and here[1] == goal[1]:
        motion, line = r["motion"], arrays.routes[at]
        line[0, 0], line[0, 1] = motion["x"], motion["y"]
        line[1, 0], line[1, 1] = points[end - 1, 0], points[end - 1, 1]
        _take(at, line[:2], slot, arrays)
    else:
        _take(at, points[first:end], slot, arrays)
    note_reroute(r)


@part
def note_reroute(r):
    """Note that a robot's route was replaced on its way; the time without a metre of progress continues."""
    r["clocks"]["milestone"] = 0.0
    r["totals"]["reroutes"] += 1


@part
def _supply(at, arrays):
    """Give a robot the route that it wants if the table has it; then another one if it begins off that route."""
    r, wanted = arrays.robots[at], arrays.wanted
    if wanted[at] > 0:
        slot = slot_in(wanted[at], arrays)
        if slot < 0:
            return
        begin_task(at, slot, arrays)
        off = is_off_route(r, arrays.routes[at], arrays.rules.far)
        wanted[at] = -_way(r, _here(r, arrays.floor), arrays.floor) if off else 0
    if wanted[at] < 0:
        slot = slot_in(-wanted[at], arrays)
        if slot >= 0:
            _reroute(at, slot, arrays)
            wanted[at] = 0


@kernel
def give(begin, end, first, steps, arrays):
    """Give goals and routes to the robots of some worlds that arrived, and routes to those off theirs.

    first: else only the routes that are still wanted; steps: int64[B], since the resets.
    """
    robots, wanted = arrays.robots, arrays.wanted
    for b in range(begin, end):
        for i in range(robots.shape[1]):
            r, at = robots[b, i], (b, i)
            if first and r["events"]["arrived"] != 0:
                here = goal_of(r)
                _book(at, whole(steps[b]), arrays)
                if r["task"]["alive"] != 0:
                    wanted[at] = _way(r, here, arrays.floor)
            elif first and is_off_route(r, arrays.routes[at], arrays.rules.far):
                wanted[at] = -_way(r, _here(r, arrays.floor), arrays.floor)
            if wanted[at] != 0:
                _supply(at, arrays)


@kernel
def follow_live(at, here, when, arrays, live):
    """Give a robot a live route from a cell to its goal; return NONE_FOUND, GIVEN or LEFT.

    live: (LiveArrays, LiveRoom); for the rest see `find_live`.
    """
    (b, i), (own, room), goal = at, live, goal_of(arrays.robots[at])
    if here[0] == goal[0] and here[1] == goal[1]:
        return NONE_FOUND
    number, users = to_goal(own, goal), RoadUsers(arrays.robots, arrays.routes, own.persons, own.person_on)
    if number < 0:
        return LEFT
    line, count = find_live(at, here, number, when, users, own, room)
    if count == 0:
        return NONE_FOUND
    if len(line) > arrays.routes.shape[2] or count > own.cells.shape[2]:
        return LEFT
    take_route(arrays.robots, arrays.routes, b, i, line, arrays.rules.heading)
    list_route(at, room.path[:count], own.reach, users, own)
    return GIVEN


@kernel
def arrive_live(steps, marks, left, arrays, live):
    """Give goals and live routes to the robots in marks bool[B, N] that arrived, and take them out of it.

    left: int64[B], -1, or the robot whose route Python must make. It has its goal; its route begins in the cell
    `wanted`. The robots after it stay in `marks`. steps: int64[B], since the resets; live: see `follow_live`.
    """
    robots, columns = arrays.robots, arrays.floor.occupied.shape[1]
    for b in range(robots.shape[0]):
        for i in range(robots.shape[1]):
            if not marks[b, i] or left[b] >= 0:
                continue
            r, at, step = robots[b, i], (b, i), whole(steps[b])
            start, marks[at] = goal_of(r), False
            _book(at, step, arrays)
            if r["task"]["alive"] == 0:
                continue
            if follow_live(at, _here(r, arrays.floor), (step, False, whole(0)), arrays, live) == GIVEN:
                row, column = goal_of(r)
                take_goal(robots, arrays.routes, b, i, row, column)
            else:
                left[b], arrays.wanted[at] = i, whole(start[0]) * columns + start[1]


@kernel
def reroute_live(steps, marks, left, arrays, live):
    """Give better routes, if there are any, to the robots in marks bool[B, N], and take them out of it.

    left: int64[B], -1, or the robot for which Python must look for a route; for the rest see `arrive_live`.
    """
    robots = arrays.robots
    for b in range(robots.shape[0]):
        for i in range(robots.shape[1]):
            if not marks[b, i] or left[b] >= 0:
                continue
            r, at, marks[b, i] = robots[b, i], (b, i), False
            did = follow_live(at, _here(r, arrays.floor), (whole(steps[b]), True, whole(0)), arrays, live)
            if did == GIVEN:
                note_reroute(r)
            elif did == LEFT:
                left[b] = i
