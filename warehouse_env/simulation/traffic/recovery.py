"""Recovery: a robot that cannot drive on searches a manoeuvre. STAGES says which, round whom, and for how long.

    found = recover(i, case, worlds, setup, avoid, scratch, stopping)

searches as each stage of the case says, one after the other, and begins the first manoeuvre that is found. Returns the
number of its arcs; 0 if the robot needs none to its goals; STAYS if it is to be off `avoid`, and is; else NONE.

Who is in a ring, or stuck: making_room.py. Who seeks a way to its own goal or route: `seek`, for the path follower.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from warehouse_env.kernel import inline, kernel, part
from warehouse_env.simulation.driver import docking, rejoin
from warehouse_env.simulation.driver.arrival import docks_from
from warehouse_env.simulation.driver.bodies import Surroundings, write_body
from warehouse_env.simulation.driver.driving import begin as begin_manoeuvre
from warehouse_env.simulation.driver.manoeuvre import EXACTLY, FAR_OFF, NONE, OFF, ROUGHLY, TRIES, Query, search
from warehouse_env.simulation.driver.scratch import MOST
from warehouse_env.simulation.physics.geometry import pose_at
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.people import RADIUS
from warehouse_env.simulation.physics.trigonometry import ZERO
from warehouse_env.simulation.state import AROUND_OTHERS
from warehouse_env.simulation.traffic import waits
from warehouse_env.simulation.traffic.path_ahead import ROOM_FOR_PEOPLE

STAYS = -3

# Cases: why a robot searches. LATE: it has waited for waits.SHUT_IN_AFTER; HELD: others are in its way.
(
    RING, RING_LATE,  # it is to leave a ring of robots that wait for each other
    LETS_OUT, LETS_OUT_LATE,  # it waits for itself: it is to let a person out
    BEHIND, BEHIND_PARKED,  # it waits for one that stands for good: which may yet go, or is parked
    ASKED, ASKED_LATE,  # it waits behind one that is shut in
    LINE, LINE_HELD,  # it cannot follow its line
    DOCKS, DOCKS_HELD,  # it is near its goal, and stops there
) = (1 << k for k in range(12))  # fmt: skip


class Stage(NamedTuple):
    """A row of the table: what is searched."""

    cases: int  # in which
    goals: int  # a kind of goals (manoeuvre.py): OFF the bodies `avoid`, ROUGHLY on its own route, or its goal EXACTly
    others: np.float32  # [m] within which bodies are gone round, of the default body
    people: np.float32  # [m] within which people are
    tries: int
    nodes: int  # of each try at most; with fewer than MOST, the first that is cut off is the last


NEAR, CLOSE, NOBODY_NEAR = np.float32(6.0), np.float32(3.0), ZERO
WALKING = np.float32(2.0)
FEW = 2  # tries of a follower round others who may go
ASIDE = 700  # nodes of a search for room near by: within a metre or two
AMONG_OTHERS = 300  # nodes of a search round others who may go

# Every stage may be deleted: its cases then have one remedy less.
STAGES = (
    Stage(RING | LETS_OUT, OFF, NEAR, WALKING, TRIES, ASIDE),
    Stage(RING_LATE | LETS_OUT_LATE, FAR_OFF, NEAR, WALKING, TRIES, MOST),
    Stage(RING | RING_LATE, ROUGHLY, NEAR, WALKING, TRIES, AMONG_OTHERS),
    Stage(BEHIND, ROUGHLY, NEAR, WALKING, TRIES, AMONG_OTHERS),
    Stage(BEHIND_PARKED, ROUGHLY, NEAR, WALKING, TRIES, MOST),
    Stage(ASKED, OFF, NEAR, WALKING, TRIES, ASIDE),
    Stage(ASKED_LATE, FAR_OFF, NEAR, WALKING, TRIES, MOST),
    Stage(DOCKS, EXACTLY, NOBODY_NEAR, ZERO, TRIES, MOST),
    Stage(DOCKS_HELD, EXACTLY, CLOSE, ZERO, FEW, AMONG_OTHERS),
    Stage(LINE | DOCKS, ROUGHLY, NOBODY_NEAR, ZERO, TRIES, MOST),
    Stage(LINE_HELD | DOCKS_HELD, ROUGHLY, CLOSE, ZERO, FEW, AMONG_OTHERS),
)


class SearchWorlds(NamedTuple):
    """What searches read and write, of all worlds, or of one."""

    robots: Any  # ROBOT[B, N]
    routes: Any  # float32[B, N, R, 2]
    persons: Any  # PERSON[B, M]
    arcs: Any  # float32[B, N, ARCS, 2], their manoeuvres


class SearchSetup(NamedTuple):
    """What stays the same."""

    params: Any  # PARAMETERS[1]
    kinds: Any  # PARAMETERS[N], or None where all robots are alike (kinds.py)
    metrics: Any  # float32[K, HEADINGS, SIDE, SIDE] [s], the turning metric of each kind (turning.py)
    floor: Any


@inline
def own_of(i, setup):
    """Return the parameters of robot i."""
    return kind_of(i, setup.params[0], setup.kinds)


@part
def write_near(i, world, others, people, setup, bodies):
    """Write the bodies of robots within `others` [m] of robot i, and of people within `people` [m]; return how many.

    bodies float32[N + M, BODY]: a person is a body that stands before it, broadside on, up to where grants end.
    """
    r, p, count = world.robots[i], own_of(i, setup), 0
    cx, cy, within = r["x"] - p["offset"] * r["cos"], r["y"] - p["offset"] * r["sin"], others * p["long"]
    for j in range(world.robots.shape[0]):
        o, other = world.robots[j], own_of(j, setup)
        x, y = o["x"] - other["offset"] * o["cos"], o["y"] - other["offset"] * o["sin"]
        square = (x - cx) * (x - cx) + (y - cy) * (y - cy)
        if ZERO < square < within * within:  # its own centre is no way off
            write_body(x, y, o["cos"], o["sin"], other, bodies[count])
            count += 1
    before = RADIUS + ROOM_FOR_PEOPLE - p["half_width"]
    for o in world.persons:
        dx, dy = o["x"] - cx, o["y"] - cy
        apart = np.sqrt(dx * dx + dy * dy)
        if ZERO < apart < people:
            c, s = dx / apart, dy / apart
            write_body(o["x"] - before * c, o["y"] - before * s, -s, c, p, bodies[count])
            count += 1
    return count


@inline
def _write_goals(r, stage, route, scratch, p):
    """Write the goals of a stage into scratch.near and scratch.far; return how many of each, none if there are none."""
    if stage.goals == ROUGHLY and r["points"] >= 2:
        return rejoin.write_goals(r, route, scratch, p)
    return docking.write_goals(r, scratch.near, p) if stage.goals == EXACTLY else 0, 0


@inline
def _begin(r, stage, found, arcs, margin, p):
    """Begin what a stage has found; return what `recover` does."""
    if stage.goals == EXACTLY and found >= 0:
        docking.begin_docking(r, found, arcs, margin, p)
    elif found > 0:
        begin_manoeuvre(r, found, arcs, margin)
    if stage.goals > FAR_OFF:
        return found
    if found > 0:
        r["aside"], r["pause"] = 1, waits.LEAVES
    return STAYS if found == 0 else found


@part
def recover(i, case, world, setup, avoid, scratch, stopping):
    """Search a manoeuvre for robot i as the stages of its case say, and begin it (see above).

    avoid float32[K, BODY]: what it is to be off in the end; stopping: see step.Features.
    """
    r, arcs, own, result = world.robots[i], world.arcs[i], own_of(i, setup), NONE
    for stage in STAGES:
        if stage.cases & case == 0:
            continue
        others = write_near(i, world, stage.others, stage.people, setup, scratch.bodies)
        near, far = _write_goals(r, stage, world.routes[i], scratch, own)
        if near == 0 and stage.goals > FAR_OFF:
            continue
        around = Surroundings(
            scratch.bodies[:others], scratch.rooms[:others], avoid, setup.floor, setup.metrics[own["kind"]], own
        )
        query = Query(
            pose_at(r["x"], r["y"], r["heading"]), r["steer"], stage.goals, scratch.near[:near], scratch.far[:far],
            around, stage.tries, stage.nodes, scratch,
        )  # fmt: skip
        found, margin, searches = NONE, ZERO, True
        if stopping is not None and stage.goals == EXACTLY:
            found, margin = docking.shoot_ahead(r, query, arcs)
            searches = found < 0 and abs(r["speed"]) <= docking.TURNING  # a search begins where the robot stands
        if searches:
            found, margin = search(query, arcs, stopping)
        result = _begin(r, stage, found, arcs, margin, own)
        if result >= 0:
            break
    return result


@kernel
def seek(begin, end, worlds, setup, scratch, stopping):
    """Search for all who seek their goal or their route in the worlds from `begin` to before `end`."""
    for b in range(begin, end):
        world = SearchWorlds(worlds.robots[b], worlds.routes[b], worlds.persons[b], worlds.arcs[b])
        for i in range(world.robots.shape[0]):
            r, case = world.robots[i], LINE
            seeks, r["seeks"] = r["seeks"], 0
            if seeks == 0 or r["alive"] == 0 or r["arrived"] != 0:  # who has arrived gets another route
                continue
            if stopping is not None and docks_from(r):
                r["docks"], case = 0, DOCKS
            if seeks == AROUND_OTHERS and write_near(i, world, CLOSE, ZERO, setup, scratch.bodies) > 0:
                case <<= 1
            found = recover(i, case, world, setup, scratch.avoid[:0], scratch, stopping)
            if stopping is not None and found == 0 and r["docks"] == 0 and r["speed"] == ZERO:
                r["docks"], r["search_wait"] = 1, ZERO  # as near its route's end as that search gets it
