"""Where a manoeuvre leads: back to the robot's own route, or out of somebody's way.

API: seek(begin, end, robots, routes, arcs, params, kinds, floor, metrics) for all that seek their routes;
     write_bodies_near(i, robots, within, p, kinds, near) -> number of bodies for
     plan_to_route(r, route, arcs, bodies, tries, most, p, floor, metric) and
     plan_aside(r, arcs, avoid, bodies, most, p, floor, metric)
The two search from where the robot stands, begin the manoeuvre if there is one, and return the number of its arcs: 0
if it needs none, -1 if there is none. For bodies, most, avoid and metric see manoeuvre.py, and driving.py for how it
is driven; tries: of manoeuvre.TRIES. With `most` below manoeuvre.MOST the first search that is cut off is the last.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline, kernel, part, whole
from warehouse_env.simulation.driver import manoeuvre
from warehouse_env.simulation.driver.bodies import BODY, write_body
from warehouse_env.simulation.driver.driving import begin as begin_manoeuvre
from warehouse_env.simulation.driver.line import way_point
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.trigonometry import HALF_PI, ZERO, arc_tan2, wrap
from warehouse_env.simulation.state import AROUND_OTHERS

FIRST, APART, MANY = np.float32(0.75), np.float32(0.4), 8  # [m] ahead, [m] between, and number of poses on the route
FAR_APART, FAR_MANY = np.float32(1.2), 20  # where none of these can be reached: a lane that must be left backwards
CRUISE = np.float32(1.3)  # [m/s] at which the rest of the way is priced
NEAR, MOST_NEAR = np.float32(3.0), 64  # [m] within which others are gone round; more bodies than fit into that
FEW = 2  # tries of a follower round others who may go
AMONG_OTHERS = 300  # nodes of a search round others who may go


@inline
def _write_goals(r, route, apart, many, goals, p):
    """Write poses along the route into goals float32[many + 3, 4]; at its end the heading is free. Return how many."""
    to_go = np.float32(r["points"] - 1) * r["spacing"] - r["position"]
    first, apart = FIRST * p["long"], apart * p["long"]
    last = min(first + apart * np.float32(many - 1), to_go)
    count = 0
    for k in range(many):
        ahead = min(first + apart * np.float32(k), to_go)
        x, y, ux, uy = way_point(r, route, ahead, ZERO)
        heading = arc_tan2(uy, ux)
        goals[count, 0], goals[count, 1], goals[count, 2] = x, y, heading
        goals[count, 3] = (last - ahead) / CRUISE
        count += 1
        if ahead == to_go:
            for quarter in range(1, 4):
                goals[count, 0], goals[count, 1] = x, y
                goals[count, 2] = wrap(heading + np.float32(quarter) * HALF_PI)
                goals[count, 3] = ZERO
                count += 1
            break
    return count


@inline
def write_bodies_near(i, robots, within, p, kinds, near):
    """Write the bodies of the others within [m] of robot i of ROBOT[N] into near float32[M, BODY]; see bodies.py.

    Returns how many, M at most. p: its own; kinds: see kinds.py.
    """
    r = robots[i]
    cx, cy = r["x"] - p["offset"] * r["cos"], r["y"] - p["offset"] * r["sin"]
    count = 0
    for j in range(robots.shape[0]):
        o, other = robots[j], kind_of(j, p, kinds)
        x, y = o["x"] - other["offset"] * o["cos"], o["y"] - other["offset"] * o["sin"]
        square = (x - cx) * (x - cx) + (y - cy) * (y - cy)
        if ZERO < square < within * within and count < near.shape[0]:  # its own centre is no way off
            write_body(x, y, o["cos"], o["sin"], other, near[count])
            count += 1
    return count


@kernel
def plan_to_route(r, route, arcs, bodies, tries, most, p, floor, metric):
    """Begin the soonest manoeuvre to a pose on the robot's own route (see above)."""
    if r["points"] < 2:
        return manoeuvre.NONE
    leave = manoeuvre.no_leave()
    near, far = np.empty((MANY + 3, 4), np.float32), np.empty((FAR_MANY + 3, 4), np.float32)
    near = near[: _write_goals(r, route, APART, whole(MANY), near, p)]
    far = far[: _write_goals(r, route, FAR_APART, whole(FAR_MANY), far, p)]
    for k in range(2 * tries):
        trial = manoeuvre.trial_of(k // 2, bodies)
        goals = near if k % 2 == 0 else far
        found = manoeuvre.search_once(
            r["x"], r["y"], r["heading"], r["steer"], goals, leave, bodies, trial, most,
            p, floor, metric, arcs,
        )  # fmt: skip
        if found > 0:
            begin_manoeuvre(r, found, arcs, manoeuvre.MARGINS[trial])
        if found >= 0:
            return found
        if found == manoeuvre.CUT_OFF and most < manoeuvre.MOST:
            break
    return manoeuvre.NONE


@kernel
def plan_aside(r, arcs, avoid, bodies, most, p, floor, metric):
    """Begin the soonest manoeuvre to a pose whose body is off all rectangles of `avoid` (see above)."""
    goals = np.empty((0, 4), np.float32)
    x, y, heading, steer = r["x"], r["y"], r["heading"], r["steer"]
    found, margin = manoeuvre.search(x, y, heading, steer, goals, avoid, bodies, most, p, floor, metric, arcs)
    if found > 0:
        begin_manoeuvre(r, found, arcs, margin)
    return found


@part
def take_up(i, robots, p, kinds, near):
    """Take up what robot i seeks; return (others near it, tries, most nodes) of its search.

    near float32[MOST_NEAR, BODY]: where the others' bodies are written. others: -1 if it seeks nothing. p: its own.
    """
    r = robots[i]
    kind, r["seeks"] = r["seeks"], 0
    if kind == 0 or r["alive"] == 0 or r["arrived"] != 0:  # who has arrived gets another route
        return -1, manoeuvre.TRIES, manoeuvre.MOST
    others = write_bodies_near(i, robots, NEAR * p["long"], p, kinds, near) if kind == AROUND_OTHERS else 0
    if others == 0:
        return 0, manoeuvre.TRIES, manoeuvre.MOST
    return others, FEW, AMONG_OTHERS


@kernel
def seek(begin, end, robots, routes, arcs, params, kinds, floor, metrics):
    """Search for all who seek their route in the worlds from `begin` to before `end`. Arguments: see step.advance;
    metrics: of each kind of robots its turning metric (turning.py).
    """
    p = params[0]
    near = np.empty((MOST_NEAR, BODY), np.float32)
    for b in range(begin, end):
        for i in range(robots.shape[1]):
            own = kind_of(i, p, kinds)
            others, tries, most = take_up(i, robots[b], own, kinds, near)
            if others >= 0:
                plan_to_route(
                    robots[b, i], routes[b, i], arcs[b, i], near[:others], tries, most, own, floor,
                    metrics[own["kind"]],
                )  # fmt: skip
