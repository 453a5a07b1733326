"""Making room: where robots wait for each other in a ring, one of them leaves the others' paths by a manoeuvre.

The one with the least right does it; if it finds no way, one along its own route between the others, else the next one.
Who waits for a robot that stands for good, and not in a ring, looks for a way round it. All searches go round all
bodies near, as they stand, and people. Who waits for itself lets a person out, and leaves its place (letting_out.py).
Whoever finds no way may be shut in from behind: then those that wait for it leave the floor behind it, the last of them
first if they must. Who is in a ring, and who searches when: waits.py.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline, kernel, part
from warehouse_env.simulation.driver.bodies import BODY, write_body
from warehouse_env.simulation.driver.manoeuvre import MOST, TRIES
from warehouse_env.simulation.driver.rejoin import AMONG_OTHERS, plan_aside, plan_to_route, write_bodies_near
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.people import RADIUS
from warehouse_env.simulation.physics.trigonometry import ZERO
from warehouse_env.simulation.rules import waits
from warehouse_env.simulation.rules.path_ahead import CENTRE_X, CENTRE_Y, COS, POSES, ROOM_FOR_PEOPLE, SIN
from warehouse_env.simulation.rules.waits import SEEKS, STAGE, STUCK
from warehouse_env.simulation.state import NOBODY

NEAR, NEAR_PEOPLE = np.float32(6.0), np.float32(2.0)  # [m] within which bodies are gone round, and who walks
BEHIND, BEHIND_STEP = 5, np.float32(0.3)  # poses, and [m] between them, to which who finds no way out wants to back off
CHAIN = 4  # robots one behind the other that are asked to leave the floor behind it


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
def _write_near(i, robots, persons, p, kinds, bodies):
    """Write the bodies near robot i into bodies float32[N + M, BODY], and for each person near one that stands before
    it, broadside on, up to where grants end; return how many. p: its own.
    """
    r = robots[i]
    count = write_bodies_near(i, robots, NEAR * p["long"], p, kinds, bodies)
    before = RADIUS + ROOM_FOR_PEOPLE - p["half_width"]
    for o in persons:
        dx, dy = o["x"] - (r["x"] - p["offset"] * r["cos"]), o["y"] - (r["y"] - p["offset"] * r["sin"])
        apart = np.sqrt(dx * dx + dy * dy)
        if ZERO < apart < NEAR_PEOPLE:
            c, s = dx / apart, dy / apart
            write_body(o["x"] - before * c, o["y"] - before * s, -s, c, p, bodies[count])
            count += 1
    return count


@part
def _leave_ring(low, robots, persons, arcs, ways, bodies, avoid, p, kinds, solid, clearance, metrics):
    """Search a way off the paths of all others in the ring for robot `low`, or if it is alone from where it stands;
    return whether there is one.
    """
    paths, poses = ways
    count, j, whole_ring = 0, robots[low]["yields_to"], False
    while not whole_ring:
        for k in range(poses[j] if j != low else 1):
            pose = paths[j, k]
            write_body(pose[CENTRE_X], pose[CENTRE_Y], pose[COS], pose[SIN], kind_of(j, p, kinds), avoid[count])
            count += 1
        j = robots[j]["yields_to"]
        whole_ring = j == low
    r, own = robots[low], kind_of(low, p, kinds)
    near = _write_near(low, robots, persons, own, kinds, bodies)
    found = plan_aside(r, arcs[low], avoid[:count], bodies[:near], own, solid, clearance, metrics[own["kind"]])
    r["aside"] = found > 0
    r["pause"] = waits.LEAVES if found > 0 else waits.PAUSE
    return found > 0


@part
def _go_round(i, robots, persons, routes, arcs, bodies, most, p, kinds, solid, clearance, metrics):
    """Search a way for robot i to its own route, in `most` nodes, round those near; return whether there is one."""
    own = kind_of(i, p, kinds)
    near = _write_near(i, robots, persons, own, kinds, bodies)
    found = plan_to_route(
        robots[i], routes[i], arcs[i], bodies[:near], TRIES, most, own, solid, clearance, metrics[own["kind"]]
    )
    return found >= 0


@inline
def _write_way_back(r, p, avoid):
    """Write the robot's body as it would be on its way straight back into avoid[:BEHIND]."""
    for k in range(BEHIND):
        behind = p["offset"] + np.float32(k + 1) * BEHIND_STEP * p["long"]
        write_body(r["x"] - behind * r["cos"], r["y"] - behind * r["sin"], r["cos"], r["sin"], p, avoid[k])


@part
def _clear_behind(i, robots, persons, arcs, bodies, avoid, p, kinds, solid, clearance, metrics):
    """Have who waits for robot i, which finds no way out, leave the floor behind it; who cannot asks its own waiter."""
    asks = i
    for _ in range(CHAIN):
        _write_way_back(robots[asks], kind_of(asks, p, kinds), avoid)
        blocked = NOBODY
        for j in range(robots.shape[0]):
            r = robots[j]
            if j == asks or r["yields_to"] != asks or not waits.may_leave(r):
                continue
            own = kind_of(j, p, kinds)
            near = _write_near(j, robots, persons, own, kinds, bodies)
            found = plan_aside(r, arcs[j], avoid[:BEHIND], bodies[:near], own, solid, clearance, metrics[own["kind"]])
            if found > 0:
                r["aside"], r["pause"] = 1, waits.LEAVES
                return
            if found < 0:
                r["pause"], blocked = waits.PAUSE, j
        if blocked == NOBODY:
            return
        asks = blocked


@part
def _resolve(robots, persons, routes, arcs, ways, found, bodies, avoid, p, kinds, solid, clearance, metrics):
    """Let those of a world search that seek or are stuck, one after another; each search changes who still is."""
    waits.look(robots, found)
    for i in range(robots.shape[0]):
        stage, low, most = found[STAGE, i], i, AMONG_OTHERS
        if stage == SEEKS:
            low = _least(i, robots)
            if _leave_ring(low, robots, persons, arcs, ways, bodies, avoid, p, kinds, solid, clearance, metrics):
                waits.look(robots, found)
                continue
        elif stage == STUCK:
            if robots[robots[i]["yields_to"]]["alive"] == 0:
                most = MOST  # else it may yet go
            robots[i]["pause"] = waits.PAUSE
        else:
            continue
        alone = robots[low]["yields_to"] == low
        if alone or not _go_round(
            low, robots, persons, routes, arcs, bodies, most, p, kinds, solid, clearance, metrics
        ):
            _clear_behind(low, robots, persons, arcs, bodies, avoid, p, kinds, solid, clearance, metrics)
        waits.look(robots, found)


@kernel
def make_room(begin, end, robots, routes, persons, arcs, paths, params, kinds, solid, clearance, metrics):
    """Let those search that seek or are stuck in the worlds from `begin` to before `end`; right after agreement.agree
    has said that somebody is. Arguments: see there, step.advance and rejoin.seek.
    """
    count = robots.shape[1]
    bodies = np.empty((count + persons.shape[1], BODY), np.float32)
    avoid = np.empty((count * POSES, BODY), np.float32)
    found, poses = waits.scratch(count), np.empty(count, np.int32)  # of paths, which a manoeuvre that begins makes void
    for b in range(begin, end):
        for i in range(count):
            poses[i] = robots[b, i]["poses"]
        ways = paths[b], poses
        _resolve(
            robots[b], persons[b], routes[b], arcs[b], ways, found, bodies, avoid, params[0], kinds, solid, clearance,
            metrics,
        )  # fmt: skip
