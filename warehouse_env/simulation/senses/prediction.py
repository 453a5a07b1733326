"""Predictions: for every (speed level, lateral offset), the time until the body would touch a neighbour.

An optional slice of the observation. The own body moves as the path follower would drive the command, and neighbours,
those of the slice `neighbours`, as they plan (plans.py); they are as large as the largest robot of the fleet. A command
that leads towards another in aisles of one cell (passages.py) also leads to a conflict, even if they would meet later.
"""

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.observation import NEIGHBOUR
from warehouse_env.simulation.driver.off_shelves import may_drive
from warehouse_env.simulation.driver.tracking import MARGIN
from warehouse_env.simulation.physics.geometry import Rectangle, body_at, separation
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO
from warehouse_env.simulation.senses import on_routes
from warehouse_env.simulation.senses.on_routes import APART, LANES
from warehouse_env.simulation.senses.passages import FAR
from warehouse_env.simulation.senses.plans import (
    ALONG_LINE,
    DIAGONAL,
    KEPT,
    KEPT_RATE,
    SAMPLES,
    Met,
    body_in,
    can_brake,
    off_line,
    point_ahead,
    side_room,
    step_towards,
    touches,
    what_forwards,
)

TOWARDS = 4  # first sample in which a way towards another counts as a conflict: a contact is worse
LOST = np.float32(0.01)  # [m] of a small gap that may be lost, or that bodies in touch may move while they leave


@inline
def _may_meet(motion, plan, most, p):
    """Whether a robot may meet one that drives as planned, wherever it drives itself, `most` [m] at most."""
    x, y, v = motion["x"], motion["y"], abs(motion["speed"])
    for k in range(SAMPLES):
        t = APART * np.float32(k + 1)
        driven = min(min(v + HALF * p["max_acceleration"] * t, p["max_speed"]) * t, most)
        reach = driven + p["far"] + p["widest"] + DIAGONAL * (KEPT + KEPT_RATE * t)
        dx, dy = plan[k, 0] - x, plan[k, 1] - y
        if dx * dx + dy * dy < reach * reach:
            return True
    return False


@inline
def _keep_near(motion, seen, sights, p):
    """Keep in `sights.who` the neighbours `seen` that the robot may meet; return a Met.

    Those that it may meet even if all brake come first.
    """
    count, braking, own = 0, 0, body_at(ZERO, ZERO, ONE, ZERO, p)
    fastest = min(abs(motion["speed"]) + p["max_acceleration"] * APART, p["max_speed"])
    to_stop = fastest * (APART + HALF * fastest / p["max_acceleration"])
    who, gaps = sights.who, sights.gaps
    for n in range(p["neighbours"]):
        at, j = n * NEIGHBOUR, who[n]
        if seen[at + 6] == ZERO:
            break
        if _may_meet(motion, sights.plans[j], FAR, p):
            ahead, left = seen[at] * p["lidar_range"], seen[at + 1] * p["lidar_range"]
            other = Rectangle(ahead, left, seen[at + 2], seen[at + 3], p["widest_length"], p["widest_width"])
            gap = separation(own, other) / DIAGONAL
            who[count], gaps[count] = j, gap - (min(LOST, gap) if gap > ZERO else LOST)
            if p["field"] == 0 and _may_meet(motion, sights.stops[j], to_stop, p):
                who[count], who[braking], gaps[count], gaps[braking] = who[braking], j, gaps[braking], gaps[count]
                braking += 1
            count += 1
    return Met(count, braking, sights)


@inline
def _may_go(r, step, count, sights, p, floor):
    """Whether the follower would drive a step (speed, steering) rather than stop before a shelf.

    `count` steps have been asked about before it. Many commands have the same next step.
    """
    asked, may = sights.asked, False
    asked[count, 0], asked[count, 1] = step
    k = 0
    while k < count and (asked[k, 0] != step[0] or asked[k, 1] != step[1]):
        k += 1
    may = asked[k, 2] != ZERO if k < count else may_drive(r, step[0], step[1], MARGIN, p, floor)
    asked[count, 2] = ONE if may else ZERO
    return may


@inline
def _write_sides(r, ahead, table, sights, p, floor):
    """Write the possible part of each offset; return how many offsets a speed has."""
    count = 0
    while count < table.shape[0] and table[count, 0] == table[0, 0]:
        sights.sides[count] = side_room(r, ahead, table[count, 1], p, floor)
        count += 1
    return count


@inline
def _twin(sides, k, on_line):
    """Return the first offset that leads to the same path as offset k."""
    twin = 0
    while on_line and sides[twin] != sides[k]:
        twin += 1
    return twin


@inline
def _try_lines(at, worlds, count, met, out, p):
    """Write the free shares of the `count` commands in the lanes into `out`."""
    sights = met.sights
    on_route, route, lanes = worlds.robots[at]["on_route"], worlds.routes[at], sights.lanes
    last = on_route["position"] + sights.free_ways[at[1]]
    for k in range(SAMPLES):
        for n in range(count):
            on_routes.aim(lanes, n, on_route, route, p)
        on_routes.drive(lanes, p)
        free = 0
        for n in range(count):
            a = sights.lane_of[n]
            on_routes.settle(lanes, n, on_route, route)
            if k == 0 and met.braking > 0:
                out[a] = can_brake(on_routes.state_of(lanes, n), met, p)
            if k < out[a] * SAMPLES:
                barred = lanes[on_routes.ALONG * LANES + n] > last
                if (k >= TOWARDS and barred) or touches(k, body_in(lanes, n, p), sights.plans, met.count, sights, p):
                    out[a] = np.float32(k) / np.float32(SAMPLES)
                else:
                    free += 1
        if free == 0:
            break


@part
def write_predictions(worlds, at, row, starts, tables, sights, p, floor):
    """Write the slice `predictions` of robot at = (b, i): the free share of the time for each command.

    row: the observation float32[D] with all other slices; starts: observation.Starts; tables float32[K, A, 2]: commands
    (speed, offset) of each kind, all offsets of a speed, then those of the next, None without predictions; sights: with
    the plans of all robots.
    """
    if tables is None:
        return
    table = tables[p["kind"]]
    r, route, out, sides = worlds.robots[at], worlds.routes[at], row[starts.predictions :], sights.sides
    forwards, met = what_forwards(r, route, p), _keep_near(r["motion"], row[starts.neighbours :], sights, p)
    for a in range(table.shape[0]):
        out[a] = ONE
    if met.count == 0 and sights.free_ways[at[1]] == FAR:
        return
    ahead, count, asked = point_ahead(r, route, p), 0, 0
    offsets = _write_sides(r, ahead, table, sights, p, floor)
    for a in range(table.shape[0]):
        speed, k, on_line = table[a, 0], a % offsets, table[a, 0] > ZERO and forwards == ALONG_LINE
        if _twin(sides, k, on_line) == k:
            if on_line and not _may_go(r, step_towards(r, ahead, speed, sides[k], p), asked, sights, p, floor):
                speed = ZERO
            asked += on_line
            if on_line and speed > ZERO:
                on_routes.begin(sights.lanes, count, r, speed, sides[k])
                sights.lane_of[count] = a
                count += 1
            else:
                out[a] = off_line(r, (route, worlds.arcs[at]), forwards, speed, p, sights.path, met, floor)
        if count == LANES or a + 1 == table.shape[0]:
            _try_lines(at, worlds, count, met, out, p)
            count = 0
    for a in range(table.shape[0]):
        k = a % offsets
        out[a] = out[a - k + _twin(sides, k, table[a, 0] > ZERO and forwards == ALONG_LINE)]
