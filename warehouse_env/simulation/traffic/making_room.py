"""Making room: where robots wait for each other in a ring, one of them leaves the others' paths by a manoeuvre.

The one with the least right does it; if it finds no way, one along its own route between the others, else the next one.
Who waits for a robot that stands for good, and not in a ring, looks for a way round it. All searches go round all
bodies near, as they stand, and people. Who waits for itself lets a person out, and leaves its place (letting_out.py).
Whoever finds no way may be shut in from behind: then those that wait for it leave the floor behind it, the last of them
first if they must. Who is in a ring, and who searches when: waits.py.

At first all look for room near by only, since another may have less far. Who has waited for waits.SHUT_IN_AFTER none
the less, as in a winding passage, searches however far room is, and those behind it leave the way that it would take
without them, round all bends (room_field.py).
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline, kernel, part, whole
from warehouse_env.simulation.driver.bodies import BODY, write_body
from warehouse_env.simulation.driver.manoeuvre import MOST, TRIES
from warehouse_env.simulation.driver.rejoin import AMONG_OTHERS, plan_aside, plan_to_route, write_bodies_near
from warehouse_env.simulation.driver.room_field import room_around, write_way
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.people import RADIUS
from warehouse_env.simulation.physics.trigonometry import ZERO
from warehouse_env.simulation.state import NOBODY
from warehouse_env.simulation.traffic import waits
from warehouse_env.simulation.traffic.path_ahead import CENTRE_X, CENTRE_Y, COS, POSES, ROOM_FOR_PEOPLE, SIN
from warehouse_env.simulation.traffic.waits import SEEKS, STAGE, STUCK

NEAR, NEAR_PEOPLE = np.float32(6.0), np.float32(2.0)  # [m] within which bodies are gone round, and who walks
ASIDE = 700  # nodes of a search for room near by: within a metre or two
BEHIND, BEHIND_STEP = 5, np.float32(0.3)  # poses, and [m] between them, to which who finds no way out wants to back off
WAY = POSES  # bodies along its way off others' paths at most, some 13 m: as many as `avoid` holds of one robot
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


@inline
def _write_ring(low, robots, ways, avoid, p, kinds):
    """Write the bodies along the paths of all others in the ring of robot `low` into avoid, or if it is alone its own
    where it stands; return how many.
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
    return count


@part
def _leave(i, robots, persons, arcs, bodies, avoid, p, kinds, floor, metrics):
    """Search a way for robot i off the bodies `avoid`; return what plan_aside does."""
    r, own = robots[i], kind_of(i, p, kinds)
    near = _write_near(i, robots, persons, own, kinds, bodies)
    most = whole(MOST) if waits.is_shut_in(r) else whole(ASIDE)
    found = plan_aside(r, arcs[i], avoid, bodies[:near], most, own, floor, metrics[own["kind"]])
    if found > 0:
        r["aside"], r["pause"] = 1, waits.LEAVES
    return found


@part
def _go_round(i, robots, persons, routes, arcs, bodies, most, p, kinds, floor, metrics):
    """Search a way for robot i to its own route, in `most` nodes, round those near; return whether there is one."""
    own = kind_of(i, p, kinds)
    near = _write_near(i, robots, persons, own, kinds, bodies)
    found = plan_to_route(robots[i], routes[i], arcs[i], bodies[:near], TRIES, most, own, floor, metrics[own["kind"]])
    return found >= 0


@inline
def _write_way_back(r, p, avoid):
    """Write the robot's body as it would be on its way straight back into avoid[:BEHIND]."""
    for k in range(BEHIND):
        behind = p["offset"] + np.float32(k + 1) * BEHIND_STEP * p["long"]
        write_body(r["x"] - behind * r["cos"], r["y"] - behind * r["sin"], r["cos"], r["sin"], p, avoid[k])


@kernel
def _write_way_out(i, robots, avoid, count, p, kinds, floor):
    """Write into avoid the bodies along the way of robot i off those in avoid[:count], past nobody but the one that it
    waits for; straight back, if there is nothing to be off or no such way. Return how many.
    """
    r, own, many = robots[i], kind_of(i, p, kinds), 0
    if count > 0:
        j, others = r["yields_to"], np.empty((1, BODY), np.float32)
        o, other = robots[j], kind_of(j, p, kinds)
        x, y = o["x"] - other["offset"] * o["cos"], o["y"] - other["offset"] * o["sin"]
        write_body(x, y, o["cos"], o["sin"], other, others[0])
        others = others[: j != i]  # nobody, if it waits for itself
        room = room_around(r["x"], r["y"], r["heading"], avoid[:count], others, own, floor)
        x, y = r["x"] - own["offset"] * r["cos"], r["y"] - own["offset"] * r["sin"]
        many = write_way(x, y, room, own, avoid[:WAY])
    if many == 0:
        _write_way_back(r, own, avoid)
        many = BEHIND
    return many


@part
def _clear_way(i, count, robots, persons, arcs, bodies, avoid, p, kinds, floor, metrics):
    """Have who waits for robot i, which finds no way out, leave the floor it needs; who cannot asks its own waiter.

    avoid[:count]: what robot i is to be off, if it is in a ring.
    """
    asks, shut_in = i, waits.is_shut_in(robots[i])
    for _ in range(CHAIN):
        count = _write_way_out(asks, robots, avoid, count if shut_in else 0, p, kinds, floor)
        blocked = NOBODY
        for j in range(robots.shape[0]):
            r = robots[j]
            if j == asks or r["yields_to"] != asks or not waits.may_leave(r):
                continue
            found = _leave(j, robots, persons, arcs, bodies, avoid[:count], p, kinds, floor, metrics)
            if found > 0:
                return
            if found < 0:
                r["pause"], blocked = waits.PAUSE, j
        if blocked == NOBODY:
            return
        asks = blocked


@part
def _resolve(robots, persons, routes, arcs, ways, found, bodies, avoid, p, kinds, floor, metrics):
    """Let those of a world search that seek or are stuck, one after another; each search changes who still is."""
    waits.look(robots, found)
    for i in range(robots.shape[0]):
        stage, low, most, count = found[STAGE, i], i, AMONG_OTHERS, 0
        if stage == SEEKS:
            low = _least(i, robots)
            count = _write_ring(low, robots, ways, avoid, p, kinds)
            if _leave(low, robots, persons, arcs, bodies, avoid[:count], p, kinds, floor, metrics) > 0:
                waits.look(robots, found)
                continue
            robots[low]["aside"], robots[low]["pause"] = 0, waits.PAUSE
        elif stage == STUCK:
            if robots[robots[i]["yields_to"]]["alive"] == 0:
                most = MOST  # else it may yet go
            robots[i]["pause"] = waits.PAUSE
        else:
            continue
        alone = robots[low]["yields_to"] == low
        if alone or not _go_round(low, robots, persons, routes, arcs, bodies, most, p, kinds, floor, metrics):
            _clear_way(low, count, robots, persons, arcs, bodies, avoid, p, kinds, floor, metrics)
        waits.look(robots, found)


@kernel
def make_room(begin, end, robots, routes, persons, arcs, paths, params, kinds, floor, metrics):
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
            robots[b], persons[b], routes[b], arcs[b], ways, found, bodies, avoid, params[0], kinds, floor,
            metrics,
        )  # fmt: skip
