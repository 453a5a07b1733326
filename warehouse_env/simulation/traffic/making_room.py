"""Making room: where robots wait for each other in a ring, one of them leaves the others' paths by a manoeuvre.

The one with the least right does it; if it finds no way, one along its own route between the others, else the next one.
Who waits for a robot that stands for good, and not in a ring, looks for a way round it. All searches go round all
bodies near, as they stand, and people (recovery.py). Who waits for itself lets a person out, and leaves its place
(letting_out.py). Whoever finds no way may be shut in from behind: then those that wait for it leave the floor behind
it, the last of them first if they must. Who is in a ring, and who searches when: waits.py.

At first all look for room near by only, since another may have less far. Who has waited for waits.SHUT_IN_AFTER none
the less, as in a winding passage, searches however far room is, and those behind it leave the way that it would take
without them, round all bends (room_field.py).
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline, kernel, part, whole
from warehouse_env.simulation.driver.bodies import Surroundings, write_body
from warehouse_env.simulation.driver.manoeuvre import NONE
from warehouse_env.simulation.driver.room_field import write_room, write_way
from warehouse_env.simulation.physics.geometry import pose_at
from warehouse_env.simulation.state import NOBODY
from warehouse_env.simulation.traffic import waits
from warehouse_env.simulation.traffic.path_ahead import CENTRE_X, CENTRE_Y, COS, POSES, SIN
from warehouse_env.simulation.traffic.recovery import (
    ASKED,
    BEHIND,
    BEHIND_PARKED,
    LETS_OUT,
    RING,
    SearchWorlds,
    own_of,
    recover,
)  # fmt: skip
from warehouse_env.simulation.traffic.waits import SEEKS, STAGE, STUCK

BEHIND_IT, BEHIND_STEP = 5, np.float32(0.3)  # poses, and [m] between them, to which who finds no way out wants to back
WAY = POSES  # bodies along its way off others' paths at most, some 13 m: as many as `avoid` holds of one robot
CHAIN = 4  # robots one behind the other that are asked to leave the floor behind it; 0: none


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
def _write_ring(low, robots, paths, setup, scratch):
    """Write the bodies along the paths of all others in the ring of robot `low` into scratch.avoid, or if it is alone
    its own where it stands; return how many.
    """
    count, j, whole_ring = 0, robots[low]["yields_to"], False
    while not whole_ring:
        for k in range(scratch.poses[j] if j != low else 1):
            pose = paths[j, k]
            write_body(pose[CENTRE_X], pose[CENTRE_Y], pose[COS], pose[SIN], own_of(j, setup), scratch.avoid[count])
            count += 1
        j = robots[j]["yields_to"]
        whole_ring = j == low
    return count


@inline
def _write_way_back(r, p, avoid):
    """Write the robot's body as it would be on its way straight back into avoid[:BEHIND_IT]; return how many."""
    for k in range(BEHIND_IT):
        behind = p["offset"] + np.float32(k + 1) * BEHIND_STEP * p["long"]
        write_body(r["x"] - behind * r["cos"], r["y"] - behind * r["sin"], r["cos"], r["sin"], p, avoid[k])
    return BEHIND_IT


@part
def _write_way_out(i, count, robots, setup, scratch):
    """Write into scratch.avoid the bodies along the way of robot i off its first `count`, past nobody but the one that
    it waits for; straight back, if there is nothing to be off or no such way. Return how many.
    """
    r, own, many = robots[i], own_of(i, setup), 0
    if count > 0:
        j = r["yields_to"]
        o, other = robots[j], own_of(j, setup)
        x, y = o["x"] - other["offset"] * o["cos"], o["y"] - other["offset"] * o["sin"]
        write_body(x, y, o["cos"], o["sin"], other, scratch.bodies[0])
        others = 1 if j != i else 0  # nobody, if it waits for itself
        around = Surroundings(
            scratch.bodies[:others], scratch.rooms[:others], scratch.avoid[:count], setup.floor,
            setup.metrics[own["kind"]], own,
        )  # fmt: skip
        write_room(pose_at(r["x"], r["y"], r["heading"]), around, scratch)
        x, y = r["x"] - own["offset"] * r["cos"], r["y"] - own["offset"] * r["sin"]
        many = write_way(x, y, scratch.room, own, scratch.avoid[:WAY])
    return many if many > 0 else _write_way_back(r, own, scratch.avoid)


@part
def _clear_way(i, count, world, setup, scratch):
    """Have who waits for robot i, which finds no way out, leave the floor it needs; who cannot asks its own waiter.

    scratch.avoid[:count]: what robot i is to be off, if it is in a ring.
    """
    robots, asks = world.robots, i
    shut_in = waits.is_shut_in(robots[i])
    for _ in range(CHAIN):
        count = _write_way_out(asks, count if shut_in else 0, robots, setup, scratch)
        blocked = NOBODY
        for j in range(robots.shape[0]):
            r = robots[j]
            if j == asks or r["yields_to"] != asks or not waits.may_leave(r):
                continue
            case = ASKED << whole(waits.is_shut_in(r))
            found = recover(j, case, world, setup, scratch.avoid[:count], scratch, None)
            if found > 0:
                return
            if found == NONE:
                r["pause"], blocked = waits.PAUSE, j
        if blocked == NOBODY:
            return
        asks = blocked


@kernel
def make_room(begin, end, worlds, paths, setup, scratch):
    """Let those search that seek or are stuck in the worlds from `begin` to before `end`; right after agreement.agree
    has said that somebody is. paths: see there. One searches after the other: each search changes who still is.
    """
    found = scratch.found
    for b in range(begin, end):
        world = SearchWorlds(worlds.robots[b], worlds.routes[b], worlds.persons[b], worlds.arcs[b])
        robots = world.robots
        for i in range(robots.shape[0]):  # of paths, which a manoeuvre that begins makes void
            scratch.poses[i] = robots[i]["poses"]
        waits.look(robots, found)
        for i in range(robots.shape[0]):
            low, count = i, 0
            if found[STAGE, i] == SEEKS:
                low = _least(i, robots)
                count = _write_ring(low, robots, paths[b], setup, scratch)
                case = LETS_OUT if robots[low]["yields_to"] == low else RING
                case <<= whole(waits.is_shut_in(robots[low]))
                robots[low]["aside"] = 0
            elif found[STAGE, i] == STUCK:
                case = BEHIND if robots[robots[i]["yields_to"]]["alive"] != 0 else BEHIND_PARKED
            else:
                continue
            robots[low]["pause"] = waits.PAUSE
            if recover(low, case, world, setup, scratch.avoid[:count], scratch, None) < 0:
                _clear_way(low, count, world, setup, scratch)
            waits.look(robots, found)
