"""Deadlock recovery: resolve wait cycles, and free robots that are stuck behind a standing robot.

In a wait cycle, the robot with the least right leaves the paths of the others by a manoeuvre. A robot that waits for
a permanently standing one searches a way around it. A robot that waits for itself leaves its place to let a person
pass. If a search fails, the robots that wait behind clear the floor there, if necessary the last one first. All
searches: recovery.py. Which robots search, and when: waits.py.

The first searches reach only near room. After waits.SHUT_IN_AFTER of waiting, as in a winding passage, the search has
no range limit, and the robots behind clear the way that this robot would take without them (driver/room_field.py).
"""

import numpy as np

from warehouse_env.kernel import inline, kernel, part, whole
from warehouse_env.simulation.driver.bodies import SearchArea, write_body, write_robot
from warehouse_env.simulation.driver.manoeuvre import NONE
from warehouse_env.simulation.driver.room_field import write_room, write_way
from warehouse_env.simulation.physics.geometry import pose_at
from warehouse_env.simulation.state import NOBODY
from warehouse_env.simulation.traffic import waits
from warehouse_env.simulation.traffic.path_ahead import CENTRE_X, CENTRE_Y, COS, POSES, SIN
from warehouse_env.simulation.traffic.recovery import (
    AWAY,
    BEHIND,
    BEHIND_PARKED,
    SearchWorld,
    own_of,
    recover,
)  # fmt: skip
from warehouse_env.simulation.traffic.waits import SEEKS, STAGE, STUCK

BEHIND_IT, BEHIND_STEP = 5, np.float32(0.3)  # poses, and [m] between them, that are cleared to back off
WAY = POSES  # bodies at most along the way out, about 13 m: `avoid` holds as many for each robot
CHAIN = 4  # robots in a row that are asked to clear the way; 0 drops this remedy


@inline
def _least(i, robots):
    """Return the robot of the wait cycle through robot i with the youngest task among those that may search.

    The last of equals: two robots that took turns would undo each other's manoeuvre.
    """
    low, j = i, robots[i]["traffic"]["yields_to"]
    while j != i:
        less = robots[j]["task"]["age"] < robots[low]["task"]["age"] or (
            robots[j]["task"]["age"] == robots[low]["task"]["age"] and j > low
        )
        if robots[j]["traffic"]["pause"] <= 0 and less:
            low = j
        j = robots[j]["traffic"]["yields_to"]
    return low


@inline
def _write_cycle(low, robots, paths, setup, scratch):
    """Write the bodies along the paths of all others in the wait cycle of robot `low` into scratch.avoid.

    Returns how many. A robot that is alone there is to leave its own body's place.
    """
    count, j, whole_cycle = 0, robots[low]["traffic"]["yields_to"], False
    while not whole_cycle:
        for k in range(scratch.poses[j] if j != low else 1):
            pose = paths[j, k]
            write_body(pose[CENTRE_X], pose[CENTRE_Y], pose[COS], pose[SIN], own_of(j, setup), scratch.avoid[count])
            count += 1
        j = robots[j]["traffic"]["yields_to"]
        whole_cycle = j == low
    return count


@inline
def _write_way_back(r, p, avoid):
    """Write into avoid[:BEHIND_IT] the bodies of a robot that backs up straight; return how many."""
    motion = r["motion"]
    for k in range(BEHIND_IT):
        behind = p["offset"] + np.float32(k + 1) * BEHIND_STEP * p["length_scale"]
        write_body(
            motion["x"] - behind * motion["cos"], motion["y"] - behind * motion["sin"], motion["cos"], motion["sin"], p,
            avoid[k],
        )  # fmt: skip
    return BEHIND_IT


@part
def _write_way_out(i, count, robots, setup, scratch):
    """Write the bodies along the way of robot i off scratch.avoid[:count] into scratch.avoid; return how many.

    The only obstacle is the robot that it waits for. Without a path, or without bodies to avoid, it backs up straight.
    """
    r, own, many = robots[i], own_of(i, setup), 0
    motion = r["motion"]
    if count > 0:
        j = r["traffic"]["yields_to"]
        write_robot(robots[j], own_of(j, setup), scratch.bodies[0])
        others = 1 if j != i else 0  # none if it waits for itself
        around = SearchArea(
            scratch.bodies[:others], scratch.rooms[:others], scratch.avoid[:count], setup.floor,
            setup.metrics[own["kind"]], own,
        )  # fmt: skip
        write_room(pose_at(motion["x"], motion["y"], motion["heading"]), around, scratch)
        x, y = motion["x"] - own["offset"] * motion["cos"], motion["y"] - own["offset"] * motion["sin"]
        many = write_way(x, y, scratch.room, own, scratch.avoid[:WAY])
    return many if many > 0 else _write_way_back(r, own, scratch.avoid)


@part
def _clear_way(i, count, world, setup, scratch):
    """Clear the path of robot i, which found no way out, by a robot that waits for it, or by those behind that one.

    scratch.avoid[:count]: bodies that robot i must be off, if it is in a wait cycle.
    """
    robots, asks = world.robots, i
    shut_in = waits.is_shut_in(robots[i])
    for _ in range(CHAIN):
        count = _write_way_out(asks, count if shut_in else 0, robots, setup, scratch)
        blocked = NOBODY
        for j in range(robots.shape[0]):
            r = robots[j]
            if j == asks or r["traffic"]["yields_to"] != asks or not waits.may_leave(r):
                continue
            case = AWAY << whole(waits.is_shut_in(r))
            found = recover(j, case, world, setup, scratch.avoid[:count], scratch, None)
            if found > 0:
                return
            if found == NONE:
                r["traffic"]["pause"], blocked = waits.PAUSE, j
        if blocked == NOBODY:
            return
        asks = blocked


@kernel
def resolve_deadlocks(begin, end, worlds, setup, scratch):
    """Search for the robots that seek or are stuck in the Worlds from `begin` to before `end`.

    Call it right after local_activation.assign_right_of_way has returned that there are some. Robots search in turn,
    since each manoeuvre can resolve the wait of others.
    """
    found = scratch.found
    for b in range(begin, end):
        world = SearchWorld(worlds.robots[b], worlds.routes[b], worlds.persons[b], worlds.arcs[b])
        robots = world.robots
        for i in range(robots.shape[0]):  # kept, since a new manoeuvre voids its robot's path
            scratch.poses[i] = robots[i]["traffic"]["poses"]
        waits.look(robots, found)
        for i in range(robots.shape[0]):
            low, count = i, 0
            if found[STAGE, i] == SEEKS:
                low = _least(i, robots)
                count = _write_cycle(low, robots, worlds.paths[b], setup, scratch)
                case = AWAY << whole(waits.is_shut_in(robots[low]))
                robots[low]["traffic"]["retreating"] = 0
            elif found[STAGE, i] == STUCK:
                case = BEHIND if robots[robots[i]["traffic"]["yields_to"]]["task"]["alive"] != 0 else BEHIND_PARKED
            else:
                continue
            robots[low]["traffic"]["pause"] = waits.PAUSE
            if recover(low, case, world, setup, scratch.avoid[:count], scratch, None) < 0:
                _clear_way(low, count, world, setup, scratch)
            waits.look(robots, found)
