"""Recovery: search a manoeuvre for a robot that cannot drive on. The table STAGES holds all goals and budgets.

    found = recover(i, case, world, setup, avoid, scratch, stopping)

runs the stages of a case in order and starts the first manoeuvre found. It returns the number of arcs: 0 if the robot
is at its goal pose already, STAYS if it is already off the bodies `avoid`, NONE if no stage finds a manoeuvre.

deadlock_recovery.py calls it for robots that wait for each other. `seek` calls it for the path follower.
"""

from typing import Any, NamedTuple

import numpy as np

from warehouse_env.kernel import inline, kernel, part, whole
from warehouse_env.simulation.driver import docking
from warehouse_env.simulation.driver.arrival import docks_from
from warehouse_env.simulation.driver.bodies import SearchArea, write_body, write_robot
from warehouse_env.simulation.driver.driving import begin as begin_manoeuvre
from warehouse_env.simulation.driver.line import way_point
from warehouse_env.simulation.driver.manoeuvre import (
    EXACTLY,
    FAR_OFF,
    NONE,
    OFF,
    ROUGHLY,
    TRIES,
    Query,
    put_goal,
    search,
)  # fmt: skip
from warehouse_env.simulation.driver.scratch import MOST
from warehouse_env.simulation.driver.tracking import AGAIN
from warehouse_env.simulation.physics.geometry import pose_at
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.people import RADIUS
from warehouse_env.simulation.physics.trigonometry import HALF_PI, ZERO, arc_tan2, wrap
from warehouse_env.simulation.state import AROUND_OTHERS
from warehouse_env.simulation.traffic import waits
from warehouse_env.simulation.traffic.path_ahead import ROOM_FOR_PEOPLE

STAYS = -3

# Cases: why a robot searches. LATE: after waits.SHUT_IN_AFTER of waiting. HELD: other robots are in the way.
(
    AWAY, AWAY_LATE,  # must leave a wait cycle, let a person pass, or clear the path of a robot that found no way
    BEHIND, BEHIND_PARKED,  # waits for a permanently standing robot: it may still go, or is parked
    LINE, LINE_HELD,  # cannot follow its route
    DOCKS, DOCKS_HELD,  # is near the goal at which it stops
) = (1 << k for k in range(8))  # fmt: skip


class Stage(NamedTuple):
    """A row of the table: a search and its budget."""

    cases: int  # that it is for, as bits
    goals: int  # OFF or FAR_OFF the bodies `avoid`, ROUGHLY on the route, or EXACTLY at the goal (manoeuvre.py)
    others: np.float32  # [m], range of robots that are obstacles, for the default body
    people: np.float32  # [m], range of people that are obstacles
    tries: int
    nodes: int  # of each try; below MOST, a try that is cut off ends the search


# Goal poses on the route, in [m]: the first one ahead, and between poses: those tried first, and those for lanes that a
# robot can only leave backwards.
FIRST, APART, FAR_APART = np.float32(0.75), np.float32(0.4), np.float32(1.2)
TURNED = 3  # more headings at the end of the route, where any will do
CRUISE = np.float32(1.3)  # [m/s] that the rest of the route is priced at

NEAR, CLOSE, NOBODY_NEAR = np.float32(6.0), np.float32(3.0), ZERO
WALKING = np.float32(2.0)
FEW = 2  # tries among robots that may still drive on
ASIDE = 700  # nodes that reach a metre or two
AMONG_OTHERS = 300  # nodes among robots that may still drive on

QUICK = 200, 10  # `nodes` and `period` of a SearchSetup for quick_searches

# To drop a remedy, delete its line.
STAGES = (
    Stage(AWAY, OFF, NEAR, WALKING, TRIES, ASIDE),
    Stage(AWAY_LATE, FAR_OFF, NEAR, WALKING, TRIES, MOST),
    Stage(BEHIND, ROUGHLY, NEAR, WALKING, TRIES, AMONG_OTHERS),
    Stage(BEHIND_PARKED, ROUGHLY, NEAR, WALKING, TRIES, MOST),
    Stage(DOCKS, EXACTLY, NOBODY_NEAR, ZERO, TRIES, MOST),
    Stage(DOCKS_HELD, EXACTLY, CLOSE, ZERO, FEW, AMONG_OTHERS),
    Stage(LINE | DOCKS, ROUGHLY, NOBODY_NEAR, ZERO, TRIES, MOST),
    Stage(LINE_HELD | DOCKS_HELD, ROUGHLY, CLOSE, ZERO, FEW, AMONG_OTHERS),
)


class SearchWorld(NamedTuple):
    """What searches read and write of one world."""

    robots: Any  # ROBOT[N]
    routes: Any  # float32[N, R, 2] [m]
    persons: Any  # PERSON[M]
    arcs: Any  # float32[N, ARCS, 2], manoeuvres


class SearchSetup(NamedTuple):
    """Constants of the searches."""

    params: Any  # PARAMETERS[1]
    kinds: Any  # PARAMETERS[N], None if all robots are alike (kinds.py)
    metrics: Any  # float32[K, HEADINGS, SIDE, SIDE] [s], the turning metric of each kind (turning.py)
    floor: Any
    nodes: Any  # of each try at most
    period: Any  # env steps from one round of searches to the next


@inline
def own_of(i, setup):
    """Return the parameters of robot i."""
    return kind_of(i, setup.params[0], setup.kinds)


@part
def write_near(i, world, others, people, setup, bodies):
    """Write robots within `others` [m] of robot i and people within `people` [m] into bodies float32[N + M, BODY].

    Returns how many. A person becomes a body between itself and the robot, broadside on, as far out as grants end.
    """
    r, p, count = world.robots[i], own_of(i, setup), 0
    motion = r["motion"]
    cx, cy, within = (
        motion["x"] - p["offset"] * motion["cos"],
        motion["y"] - p["offset"] * motion["sin"],
        others * p["length_scale"],
    )
    for j in range(world.robots.shape[0]):
        o, other = world.robots[j], own_of(j, setup)
        x, y = (
            o["motion"]["x"] - other["offset"] * o["motion"]["cos"],
            o["motion"]["y"] - other["offset"] * o["motion"]["sin"],
        )
        square = (x - cx) * (x - cx) + (y - cy) * (y - cy)
        if ZERO < square < within * within:  # not the robot itself
            write_robot(o, other, bodies[count])
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
def _write_poses_ahead(r, route, apart, goals, p):
    """Write poses along the route, `apart` [m], into goals float32[K + TURNED, GOAL]; return how many."""
    on_route = r["on_route"]
    many = goals.shape[0] - TURNED
    to_go = np.float32(on_route["points"] - 1) * on_route["spacing"] - on_route["position"]
    first, apart = FIRST * p["length_scale"], apart * p["length_scale"]
    last = min(first + apart * np.float32(many - 1), to_go)
    for k in range(many):
        ahead = min(first + apart * np.float32(k), to_go)
        x, y, ux, uy = way_point(r, route, ahead, ZERO)
        heading = arc_tan2(uy, ux)
        put_goal(goals, k, x, y, heading, (last - ahead) / CRUISE)
        if ahead == to_go:
            for quarter in range(1, 1 + TURNED):
                put_goal(goals, k + quarter, x, y, wrap(heading + np.float32(quarter) * HALF_PI), ZERO)
            return k + 1 + TURNED
    return many


@inline
def _write_goals(r, stage, route, scratch, p):
    """Write the goal poses of a stage into scratch.near and scratch.far; return how many of each."""
    if stage.goals == ROUGHLY and r["on_route"]["points"] >= 2:
        near = _write_poses_ahead(r, route, APART, scratch.near, p)
        return near, _write_poses_ahead(r, route, FAR_APART, scratch.far, p)
    return docking.write_goals(r, scratch.near, p) if stage.goals == EXACTLY else 0, 0


@inline
def _begin(r, stage, found, arcs, margin, p):
    """Start the manoeuvre that a stage found; return what `recover` returns."""
    if stage.goals == EXACTLY and found >= 0:
        docking.begin_docking(r, found, arcs, margin, p)
    elif found > 0:
        begin_manoeuvre(r, found, arcs, margin)
    if stage.goals > FAR_OFF:
        return found
    if found > 0:
        r["traffic"]["retreating"], r["traffic"]["pause"] = 1, waits.LEAVES
    return STAYS if found == 0 else found


@part
def recover(i, case, world, setup, avoid, scratch, stopping):
    """Run the stages of a case for robot i, and start the first manoeuvre found (see above).

    avoid float32[K, BODY]: bodies that the end pose must be off; stopping: see step.Features.
    """
    r, arcs, own, result = world.robots[i], world.arcs[i], own_of(i, setup), NONE
    motion = r["motion"]
    for stage in STAGES:
        if stage.cases & case == 0:
            continue
        others = write_near(i, world, stage.others, stage.people, setup, scratch.bodies)
        near, far = _write_goals(r, stage, world.routes[i], scratch, own)
        if near == 0 and stage.goals > FAR_OFF:
            continue
        around = SearchArea(
            scratch.bodies[:others], scratch.rooms[:others], avoid, setup.floor, setup.metrics[own["kind"]], own
        )
        query = Query(
            pose_at(motion["x"], motion["y"], motion["heading"]), motion["steer"],
            stage.goals, scratch.near[:near], scratch.far[:far], around,
            stage.tries, min(whole(stage.nodes), setup.nodes), scratch,
        )  # fmt: skip
        found, margin, searches = NONE, ZERO, True
        if stopping is not None and stage.goals == EXACTLY:
            found, margin = docking.shoot_ahead(r, query, arcs)
            searches = found < 0 and abs(motion["speed"]) <= docking.TURNING  # a search begins where the robot stands
        if searches:
            found, margin = search(query, arcs, stopping)
        result = _begin(r, stage, found, arcs, margin, own)
        if result >= 0:
            break
    return result


@inline
def seek_one(b, i, worlds, setup, scratch, stopping):
    """Search for robot i of world b if its follower seeks a manoeuvre, and the world's round of searches is due."""
    r, case = worlds.robots[b, i], LINE
    manoeuvre = r["manoeuvre"]
    seeks = manoeuvre["seeks"]
    if seeks == 0 or worlds.steps[b] % setup.period != 0:
        return
    manoeuvre["seeks"] = 0
    if r["task"]["alive"] == 0 or r["events"]["arrived"] != 0:  # an arrived robot gets another route
        return
    world = SearchWorld(worlds.robots[b], worlds.routes[b], worlds.persons[b], worlds.arcs[b])
    if stopping is not None and docks_from(r):
        manoeuvre["docks"], case = 0, DOCKS
    if seeks == AROUND_OTHERS:
        if write_near(i, world, CLOSE, ZERO, setup, scratch.bodies) > 0:
            case <<= 1
        else:
            manoeuvre["search_wait"] = AGAIN
    found = recover(i, case, world, setup, scratch.avoid[:0], scratch, stopping)
    if stopping is not None and found == 0 and manoeuvre["docks"] == 0 and r["motion"]["speed"] == ZERO:
        # a search gets it no nearer to the end of its route
        manoeuvre["docks"], manoeuvre["search_wait"] = 1, ZERO


@kernel
def seek(begin, end, worlds, setup, scratch, stopping):
    """Search for all robots whose follower seeks a manoeuvre, in the Worlds from `begin` to before `end`."""
    for b in range(begin, end):
        for i in range(worlds.robots.shape[1]):
            seek_one(b, i, worlds, setup, scratch, stopping)
