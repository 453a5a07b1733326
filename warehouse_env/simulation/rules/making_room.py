"""Making room: where robots wait for each other in a ring, one of them leaves the others' paths by a manoeuvre.

The one with the least right does it; if it finds no way, one along its own route between the others, else the next one.
Who waits for a robot that stands for good, and not in a ring, looks for a way round it. All searches go round all
bodies near, as they stand. Whoever finds no way may be shut in from behind: then those that wait for it leave the floor
behind it, the last of them first if they must.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline, kernel, part
from warehouse_env.simulation.driver.manoeuvre import MOST
from warehouse_env.simulation.driver.rejoin import AMONG_OTHERS, plan_aside, plan_to_route
from warehouse_env.simulation.physics.trigonometry import HALF, ZERO
from warehouse_env.simulation.rules.path_ahead import CENTRE_X, CENTRE_Y, DRIVEN, POSES
from warehouse_env.simulation.state import NOBODY

PATIENCE = np.float32(2.0)  # [s] that a robot stands before it looks for a way out of a ring; twice that for one round
NEAR = np.float32(6.0)  # [m] within which bodies are gone round
PAUSE = np.float32(3.0)  # [s] until a robot that found no way searches again
BACK, BACK_STEP = 5, np.float32(0.3)  # poses, and [m] between them, to which one who finds no way out wants to back off
CHAIN = 4  # robots one behind the other that are asked to
SETTLE = np.float32(5.0)  # [s] until one that has made room does


@inline
def _bodies_near(i, paths, bodies):
    """Write the others' bodies near robot i into bodies float32[N, 4]; return how many."""
    count = 0
    for j in range(paths.shape[0] - 1):
        dx = paths[j, 0, CENTRE_X] - paths[i, 0, CENTRE_X]
        dy = paths[j, 0, CENTRE_Y] - paths[i, 0, CENTRE_Y]
        if j != i and dx * dx + dy * dy < NEAR * NEAR:
            for column in range(DRIVEN):
                bodies[count, column] = paths[j, 0, column]
            count += 1
    return count


@inline
def _in_ring(i, robots):
    """Whether all that wait for each other from robot i on come back to it, have stood for a while, and none leaves."""
    j, steps = robots[i]["yields_to"], 0
    while j != NOBODY and j != i and steps < robots.shape[0]:
        leaves = robots[j]["aside"] != 0 and robots[j]["pause"] > 0
        if leaves or robots[j]["waiting_time"] < HALF * PATIENCE:
            return False
        j = robots[j]["yields_to"]
        steps += 1
    return j == i


@inline
def _least(i, robots):
    """Return who of the ring through robot i has been shortest on its way, of those that may search.

    Of equals always the last: two that took turns would undo each other's way.
    """
    low, j = i, robots[i]["yields_to"]
    while j != i:
        less = robots[j]["age"] < robots[low]["age"] or (robots[j]["age"] == robots[low]["age"] and j > low)
        if robots[j]["pause"] <= 0 and less:
            low = j
        j = robots[j]["yields_to"]
    return low


@inline
def _stands(r):
    """Whether a robot stands for good, as far as can be told: for a while, or parked, which counts no time any more."""
    return r["alive"] == 0 or r["waiting_time"] > PATIENCE


@part
def _leave_ring(low, robots, arcs, ways, bodies, avoid, p, solid, clearance, metric):
    """Search a way off the paths of all others in the ring for robot `low`; return whether there is one."""
    paths, poses = ways
    count, j = 0, robots[low]["yields_to"]
    while j != low:
        for k in range(poses[j]):
            for column in range(DRIVEN):
                avoid[count, column] = paths[j, k, column]
            count += 1
        j = robots[j]["yields_to"]
    near = _bodies_near(low, paths, bodies)
    r = robots[low]
    found = plan_aside(r, arcs[low], avoid[:count], bodies[:near], p, solid, clearance, metric)
    r["aside"] = found > 0
    r["pause"] = SETTLE if found > 0 else PAUSE
    return found > 0


@part
def _go_round(i, robots, routes, arcs, ways, bodies, most, p, solid, clearance, metric):
    """Search a way for robot i to its own route, in `most` nodes, round those near; return whether there is one."""
    near = _bodies_near(i, ways[0], bodies)
    return plan_to_route(robots[i], routes[i], arcs[i], bodies[:near], most, p, solid, clearance, metric) >= 0


@inline
def _write_way_back(r, p, avoid):
    """Write the robot's body as it would be on its way straight back into avoid[:BACK]."""
    for k in range(BACK):
        behind = p["offset"] + np.float32(k + 1) * BACK_STEP
        avoid[k, 0], avoid[k, 1] = r["x"] - behind * r["cos"], r["y"] - behind * r["sin"]
        avoid[k, 2], avoid[k, 3] = r["cos"], r["sin"]


@part
def _clear_behind(i, robots, arcs, ways, bodies, avoid, p, solid, clearance, metric):
    """Have who waits for robot i, which finds no way out, leave the floor behind it; who cannot asks its own waiter."""
    asks = i
    for _ in range(CHAIN):
        _write_way_back(robots[asks], p, avoid)
        blocked = NOBODY
        for j in range(robots.shape[0]):
            r = robots[j]
            leaves = r["aside"] != 0 and r["pause"] > 0
            if r["yields_to"] != asks or r["alive"] == 0 or leaves or r["waiting_time"] < HALF * PATIENCE:
                continue
            near = _bodies_near(j, ways[0], bodies)
            found = plan_aside(r, arcs[j], avoid[:BACK], bodies[:near], p, solid, clearance, metric)
            if found > 0:
                r["aside"], r["pause"] = 1, SETTLE
                return
            if found < 0:
                r["pause"], blocked = PAUSE, j
        if blocked == NOBODY:
            return
        asks = blocked


@inline
def _seeks(i, robots):
    """Whether robot i has waited long enough to look for a way, and may."""
    r = robots[i]
    barrier = r["yields_to"]
    if r["alive"] == 0 or r["settled"] <= 0 or r["waiting_time"] < PATIENCE or r["pause"] > 0 or barrier == NOBODY:
        return False
    return _in_ring(i, robots) or (r["waiting_time"] > PATIENCE + PATIENCE and _stands(robots[barrier]))


@part
def count_seeking(robots, p):
    """Return how many robots of a world look for a way now; a decision's time of their pauses passes."""
    seconds, count = p["time_step"] * np.float32(p["repeat"]), 0
    for r in robots:
        r["pause"] = max(r["pause"] - seconds, ZERO)
    for i in range(robots.shape[0]):
        count += _seeks(i, robots)
    return count


@part
def _resolve(robots, routes, arcs, ways, bodies, avoid, p, solid, clearance, metric):
    """Let those of a world search that seek, one after another; who still does is asked anew for each."""
    for i in range(robots.shape[0]):
        if not _seeks(i, robots):
            continue
        if _in_ring(i, robots):
            low = _least(i, robots)
            if _leave_ring(low, robots, arcs, ways, bodies, avoid, p, solid, clearance, metric):
                continue
            if not _go_round(low, robots, routes, arcs, ways, bodies, AMONG_OTHERS, p, solid, clearance, metric):
                _clear_behind(low, robots, arcs, ways, bodies, avoid, p, solid, clearance, metric)
        else:
            r = robots[i]
            most = MOST if robots[r["yields_to"]]["alive"] == 0 else AMONG_OTHERS  # it may yet go
            r["pause"] = PAUSE
            if not _go_round(i, robots, routes, arcs, ways, bodies, most, p, solid, clearance, metric):
                _clear_behind(i, robots, arcs, ways, bodies, avoid, p, solid, clearance, metric)


@kernel
def make_room(begin, end, robots, routes, arcs, paths, params, solid, clearance, metric):
    """Let those search that seek in the worlds from `begin` to before `end`; right after agreement.agree has said that
    somebody does. Arguments: see there and step.advance.
    """
    count = robots.shape[1]
    bodies, avoid = np.empty((count, 4), np.float32), np.empty((count * POSES, 4), np.float32)
    poses = np.empty(count, np.int32)  # of the paths, which a manoeuvre that begins makes void
    for b in range(begin, end):
        for i in range(count):
            poses[i] = robots[b, i]["poses"]
        ways = paths[b], poses
        _resolve(robots[b], routes[b], arcs[b], ways, bodies, avoid, params[0], solid, clearance, metric)
