"""The kernel that places the robots of worlds that begin, with their first goals and routes."""

import numpy as np

from warehouse_env.kernel import kernel, part, whole
from warehouse_env.maps.grid_map import MOVES
from warehouse_env.maps.standing import centre_of
from warehouse_env.simulation.draws import ELSEWHERE, START, shuffle
from warehouse_env.simulation.tasks.giving import (
    GIVEN,
    begin_task,
    draw_goal,
    follow_live,
    goal_of,
    key_between,
    slot_in,
    span_of,
)
from warehouse_env.simulation.tasks.goals import forget_goals
from warehouse_env.simulation.tasks.placement import stand_facing
from warehouse_env.simulation.tasks.tasks import take_goal
from warehouse_env.simulation.traffic.live_search import first_move, to_goal

TAKEN, STANDS, WANTS = range(3)  # on a cell there is no room for a robot; it stands there; it wants a route first
TO_PLACE = 1  # status of a world whose robots are to be placed; 0: they stand; -k: only k - 1 found room


@part
def _stand_on_route(at, here, body, arrays):
    """See `_stand`; the route is that of the table."""
    (world, robot), (p, kinds, floor), lines = at, body, arrays.lines
    key = key_between(here, goal_of(arrays.robots[at]), 0, arrays.floor)
    slot = slot_in(key, arrays)
    arrays.wanted[at] = key if slot < 0 else 0
    if slot < 0:
        return WANTS
    x, y = centre_of(here[0], here[1], arrays.floor.occupied.shape[0], arrays.floor.size)
    points, (first, end) = lines.points, span_of(slot, lines)
    second = min(first + 2, end - 1)
    dx, dy = points[second, 0] - points[first, 0], points[second, 1] - points[first, 1]
    if not stand_facing(arrays.robots[world], robot, (x, y, dx, dy), p, kinds, floor):
        return TAKEN
    begin_task(at, slot, arrays)
    return STANDS


@kernel
def _stand(at, here, body, arrays, live):
    """Put a robot on a cell, facing along its route to its goal; return TAKEN, STANDS or WANTS.

    body: (p, kinds, floor), as `_fits` takes them; live: see `place`.
    """
    if live is None:
        return _stand_on_route(at, here, body, arrays)
    (world, robot), (p, kinds, floor) = at, body
    goal = to_goal(live[0], goal_of(arrays.robots[at]))
    if goal < 0:
        return WANTS
    row, column, none = whole(here[0]), whole(here[1]), whole(0)
    move = first_move(live[0].fields[goal], none, none, live[0].steps, row, column)
    if move < 0:
        return WANTS
    x, y = centre_of(here[0], here[1], arrays.floor.occupied.shape[0], arrays.floor.size)
    start = x, y, np.float32(MOVES[move, 1]), np.float32(-MOVES[move, 0])
    if not stand_facing(arrays.robots[world], robot, start, p, kinds, floor):
        return TAKEN
    if follow_live(at, (row, column), (none, False, none), arrays, live) != GIVEN:
        return WANTS
    goal_row, goal_column = goal_of(arrays.robots[at])
    take_goal(arrays.robots, arrays.routes, world, robot, goal_row, goal_column)
    return STANDS


@kernel
def _stand_on_one(at, cells, places, body, arrays, live):
    """Put a robot on a cell on which it touches nothing: the first of places, (int32[K], the first that counts).

    Returns TAKEN, STANDS or WANTS, and how many of the places were tried.
    """
    order, first = places
    (world, robot), (p, kinds, floor), rows = at, body, arrays.floor.occupied.shape[0]
    for k in range(first, len(order)):
        here = cells[order[k], 0], cells[order[k], 1]
        draw_goal(at, here, arrays)
        x, y = centre_of(here[0], here[1], rows, arrays.floor.size)
        one, other = (x, y, np.float32(1.0), np.float32(0.0)), (x, y, np.float32(0.0), np.float32(1.0))
        # asked before a route is wanted, which takes far longer to make, for most of these cells are taken
        for way in (one, other):
            if stand_facing(arrays.robots[world], robot, way, p, kinds, floor):
                did = _stand(at, here, body, arrays, live)
                if did != TAKEN:
                    return did, k + 1
                break
    return TAKEN, len(order)


@kernel
def _place(world, orders, body, arrays, live):
    """Place the robots of a world; return the world's status. For the rest see `place`."""
    order, rest = orders
    endpoints, count, wants = arrays.floor.endpoints, arrays.robots.shape[1], False
    forget_goals(arrays.goals, world, arrays.keys[world])
    shuffle(arrays.keys[world], START, order)
    for i in range(count):  # all routes are wanted at once
        here = endpoints.cells[order[i], 0], endpoints.cells[order[i], 1]
        draw_goal((world, i), here, arrays)
        if live is None:
            key = key_between(here, goal_of(arrays.robots[world, i]), 0, arrays.floor)
            arrays.wanted[world, i] = key if slot_in(key, arrays) < 0 else 0
            wants = wants or arrays.wanted[world, i] != 0
    spare, elsewhere = whole(count), whole(0)
    for i in range(count):
        if wants:
            return TO_PLACE
        at, number = (world, i), order[i]
        did = _stand(at, (endpoints.cells[number, 0], endpoints.cells[number, 1]), body, arrays, live)
        if did == TAKEN:
            did, spare = _stand_on_one(at, endpoints.cells, (order, spare), body, arrays, live)
        if did == TAKEN:
            if elsewhere == 0:
                shuffle(arrays.keys[world], ELSEWHERE, rest)
            did, elsewhere = _stand_on_one(at, endpoints.elsewhere, (rest, elsewhere), body, arrays, live)
        if did == TAKEN:
            return -1 - i
        wants = did == WANTS
    return TO_PLACE if wants else 0


@kernel
def place(begin, end, status, orders, body, arrays, live):
    """Place the robots of the worlds whose status int32[B] is TO_PLACE, with their first goals and routes.

    orders: (int32[E], int32[K]), scratch; body: (p, kinds, floor), as `_fits` takes them; live: see `follow_live`, or
    None: routes are those of the table, and a world in which a robot wants one is begun anew by the next call.
    """
    for b in range(begin, end):
        if status[b] == TO_PLACE:
            status[b] = _place(b, orders, body, arrays, live)
