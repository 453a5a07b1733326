"""Kernels that give robots goals and routes: at the reset, on arrival, and off their routes.

A route that is not in the floor's table yet is `wanted`: the host makes it (RouteTable.fill), and calls again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import inline, kernel, part, whole
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.standing import centre_of, standing_cell
from warehouse_env.routes.route_table import Lines, behind_of, key_of, slot_of
from warehouse_env.simulation.draws import ELSEWHERE, START, shuffle
from warehouse_env.simulation.tasks.goals import NONE, Endpoints, GoalState, endpoints_of, forget_goals, next_goal
from warehouse_env.simulation.tasks.placement import stand_facing
from warehouse_env.simulation.tasks.tasks import book_arrival, take_end, take_goal, take_route
from warehouse_env.simulation.traffic.off_route import is_off_route

TAKEN, STANDS, WANTS = range(3)  # on a cell there is no room for a robot; it stands there; it wants a route first
TO_PLACE = 1  # status of a world whose robots are to be placed; 0: they stand; -k: only k - 1 found room


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
def _goal_of(r):
    return r["task"]["goal_row"], r["task"]["goal_col"]


@part
def _key(start, goal, behind, floor):
    """Return the key of the route between two cells (row, column)."""
    rows, columns = floor.occupied.shape
    first, last = whole(start[0]) * columns + start[1], whole(goal[0]) * columns + goal[1]
    return key_of(first, last, behind, rows * columns)


@part
def _slot(key, arrays):
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
def _part_of(slot, lines):
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
    goal = _goal_of(r)
    behind = behind_of(floor.closed, here[0], here[1], goal[0], goal[1], np.float64(r["motion"]["heading"]))
    if here[0] == goal[0] and here[1] == goal[1]:
        behind = 0
    return _key(here, goal, behind, floor)


@part
def _arrive(at, step, arrays):
    """Book a robot's arrival, draw its next goal, and want the route there; step: the world's env step."""
    (world, robot), rules = at, arrays.rules
    r, seconds = arrays.robots[at], np.float64(step * rules.repeat) * rules.time_step
    driven, planned = book_arrival(arrays.robots, world, robot, seconds, 2 * step > rules.max_steps)
    arrays.booked[world, robot, 0], arrays.booked[world, robot, 1] = driven, planned
    if r["task"]["alive"] != 0:
        here = _goal_of(r)
        _draw_goal(at, here, arrays)
        arrays.wanted[at] = _way(r, here, arrays.floor)


@part
def _draw_goal(at, here, arrays):
    """Draw the next goal of a robot in a cell (row, column); where robots wait for orders, it is that cell."""
    (world, robot), endpoints, task = at, arrays.floor.endpoints, arrays.robots[at]["task"]
    number = np.int32(NONE)
    if not arrays.rules.idle:
        number = next_goal(arrays.goals, world, robot, endpoints.number[here], arrays.keys[world], endpoints)
    task["goal_row"], task["goal_col"] = here
    if number != NONE:
        task["goal_row"], task["goal_col"] = endpoints.cells[number, 0], endpoints.cells[number, 1]


@part
def _begin_task(at, slot, arrays):
    """Give a robot the route in a slot as the first to its goal."""
    first, end = _part_of(slot, arrays.lines)
    _take(at, arrays.lines.points[first:end], slot, arrays)
    row, column = _goal_of(arrays.robots[at])
    take_goal(arrays.robots, arrays.routes, at[0], at[1], row, column)


@part
def _reroute(at, slot, arrays):
    """Give a robot the route in a slot to its goal, from where it is; in the goal's cell, straight to its end."""
    r = arrays.robots[at]
    here, goal, points = _here(r, arrays.floor), _goal_of(r), arrays.lines.points
    first, end = _part_of(slot, arrays.lines)
    if here[0] == goal[0] and here[1] == goal[1]:
        motion, line = r["motion"], arrays.routes[at]
        line[0, 0], line[0, 1] = motion["x"], motion["y"]
        line[1, 0], line[1, 1] = points[end - 1, 0], points[end - 1, 1]
        _take(at, line[:2], slot, arrays)
    else:
        _take(at, points[first:end], slot, arrays)
    r["clocks"]["milestone"] = 0.0
    r["totals"]["reroutes"] += 1


@part
def _supply(at, arrays):
    """Give a robot the route that it wants if the table has it; then another one if it begins off that route."""
    r, wanted = arrays.robots[at], arrays.wanted
    if wanted[at] > 0:
        slot = _slot(wanted[at], arrays)
        if slot < 0:
            return
        _begin_task(at, slot, arrays)
        off = is_off_route(r, arrays.routes[at], arrays.rules.far)
        wanted[at] = -_way(r, _here(r, arrays.floor), arrays.floor) if off else 0
    if wanted[at] < 0:
        slot = _slot(-wanted[at], arrays)
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
                _arrive(at, whole(steps[b]), arrays)
            elif first and is_off_route(r, arrays.routes[at], arrays.rules.far):
                wanted[at] = -_way(r, _here(r, arrays.floor), arrays.floor)
            if wanted[at] != 0:
                _supply(at, arrays)


@part
def _stand(at, here, body, arrays):
    """Put a robot on a cell, facing along its route to its goal; return TAKEN, STANDS or WANTS.

    body: (p, kinds, floor), as `_fits` takes them.
    """
    (world, robot), (p, kinds, floor), lines = at, body, arrays.lines
    key = _key(here, _goal_of(arrays.robots[at]), 0, arrays.floor)
    slot = _slot(key, arrays)
    arrays.wanted[at] = key if slot < 0 else 0
    if slot < 0:
        return WANTS
    x, y = centre_of(here[0], here[1], arrays.floor.occupied.shape[0], arrays.floor.size)
    points, (first, end) = lines.points, _part_of(slot, lines)
    second = min(first + 2, end - 1)
    dx, dy = points[second, 0] - points[first, 0], points[second, 1] - points[first, 1]
    if not stand_facing(arrays.robots[world], robot, (x, y, dx, dy), p, kinds, floor):
        return TAKEN
    _begin_task(at, slot, arrays)
    return STANDS


@part
def _stand_on_one(at, cells, order, first, body, arrays):
    """Put a robot on a cell, the first from `first` on in an order, on which it touches nothing.

    Returns TAKEN, STANDS or WANTS, and how many of the order were tried.
    """
    (world, robot), (p, kinds, floor), rows = at, body, arrays.floor.occupied.shape[0]
    for k in range(first, len(order)):
        here = cells[order[k], 0], cells[order[k], 1]
        _draw_goal(at, here, arrays)
        x, y = centre_of(here[0], here[1], rows, arrays.floor.size)
        one, other = (x, y, np.float32(1.0), np.float32(0.0)), (x, y, np.float32(0.0), np.float32(1.0))
        # asked before a route is wanted, which takes far longer to make, for most of these cells are taken
        for way in (one, other):
            if stand_facing(arrays.robots[world], robot, way, p, kinds, floor):
                did = _stand(at, here, body, arrays)
                if did != TAKEN:
                    return did, k + 1
                break
    return TAKEN, len(order)


@part
def _place(world, order, rest, body, arrays):
    """Place the robots of a world; return the world's status. order: int32[E], rest: int32[K], scratch."""
    endpoints, count, wants = arrays.floor.endpoints, arrays.robots.shape[1], False
    forget_goals(arrays.goals, world, arrays.keys[world])
    shuffle(arrays.keys[world], START, order)
    for i in range(count):  # all routes are wanted at once
        here = endpoints.cells[order[i], 0], endpoints.cells[order[i], 1]
        _draw_goal((world, i), here, arrays)
        key = _key(here, _goal_of(arrays.robots[world, i]), 0, arrays.floor)
        arrays.wanted[world, i] = key if _slot(key, arrays) < 0 else 0
        wants = wants or arrays.wanted[world, i] != 0
    spare, elsewhere = whole(count), whole(0)
    for i in range(count):
        if wants:
            return TO_PLACE
        at, number = (world, i), order[i]
        did = _stand(at, (endpoints.cells[number, 0], endpoints.cells[number, 1]), body, arrays)
        if did == TAKEN:
            did, spare = _stand_on_one(at, endpoints.cells, order, spare, body, arrays)
        if did == TAKEN:
            if elsewhere == 0:
                shuffle(arrays.keys[world], ELSEWHERE, rest)
            did, elsewhere = _stand_on_one(at, endpoints.elsewhere, rest, elsewhere, body, arrays)
        if did == TAKEN:
            return -1 - i
        wants = did == WANTS
    return TO_PLACE if wants else 0


@kernel
def place(begin, end, status, orders, body, arrays):
    """Place the robots of the worlds whose status int32[B] is TO_PLACE, with their first goals and routes.

    orders: (int32[E], int32[K]), scratch; body: (p, kinds, floor), as `_fits` takes them. A world in which a robot
    wants a route is begun anew by the next call.
    """
    order, rest = orders
    for b in range(begin, end):
        if status[b] == TO_PLACE:
            status[b] = _place(b, order, rest, body, arrays)
            for i in range(arrays.robots.shape[1]):
                r = arrays.robots[b, i]
                r["clocks"]["anchor_x"], r["clocks"]["anchor_y"] = r["motion"]["x"], r["motion"]["y"]
