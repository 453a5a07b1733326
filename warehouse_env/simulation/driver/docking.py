"""Docking: the manoeuvre to a goal's exact pose, of robots that stop at their goals.

A single shot from where the robot will be once it has slowed down (shots.py), else a search that ends with one.
`seek` takes the place of rejoin.seek where robots stop at goals; what it begins, driving.py drives.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline, kernel
from warehouse_env.simulation.driver import manoeuvre
from warehouse_env.simulation.driver.arrival import BRAKING, docks_from
from warehouse_env.simulation.driver.bodies import BODY, write_rooms
from warehouse_env.simulation.driver.driving import begin as begin_manoeuvre
from warehouse_env.simulation.driver.rejoin import MOST_NEAR, plan_to_route, take_up
from warehouse_env.simulation.driver.shots import MOST_ARCS, shoot
from warehouse_env.simulation.physics.footprint import sweep_is_free
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.kinematics import curvature, roll
from warehouse_env.simulation.physics.trigonometry import HALF, HALF_PI, PI, ZERO, sin_cos, wrap

HEADINGS = 4  # tried where any heading will do
_TURNING = np.float32(0.2)  # [m/s] from which a robot may take any turn


@inline
def _write_goals(r, goals, p):
    """Write the robot's goal into goals float32[HEADINGS, 4], for each heading that is tried; return how many."""
    free = np.isnan(r["goal_heading"])
    for k in range(HEADINGS):
        goals[k, 0], goals[k, 1], goals[k, 3] = r["goal_x"], r["goal_y"], ZERO
        goals[k, 2] = wrap(r["heading"] + np.float32(k) * HALF_PI) if free else r["goal_heading"]
    if r["either"] == 0:
        return HEADINGS if free else 1
    goals[1, 0], goals[1, 1], goals[1, 2] = _other_way_round(r, p)
    return 2


@inline
def _other_way_round(r, p):
    """Return the pose (x, y, heading) at which a robot's body stands where it does at its goal, the other way round."""
    s, c = sin_cos(r["goal_heading"])
    between = p["offset"] + p["offset"]
    return r["goal_x"] - between * c, r["goal_y"] - between * s, wrap(r["goal_heading"] + PI)


@inline
def _dock(r, count, arcs, margin, p):
    """Begin the manoeuvre of `count` arcs to the robot's goal: which way round it stands there is settled with it."""
    begin_manoeuvre(r, count, arcs, margin)
    r["docks"] = 1
    if r["either"] == 0:
        return
    heading = r["heading"]
    for k in range(count):
        heading = wrap(heading + wrap(arcs[k, 0] * curvature(arcs[k, 1], p["wheelbase"])))
    if abs(wrap(heading - r["goal_heading"])) > HALF_PI:
        r["goal_x"], r["goal_y"], r["goal_heading"] = _other_way_round(r, p)


@inline
def _slowed_down(r, p):
    """Return (pose x, y, heading, metres to it) at which a robot that brakes now has slowed down enough to turn."""
    way = max(r["speed"] * r["speed"] - _TURNING * _TURNING, ZERO) * HALF / (BRAKING * p["max_acceleration"])
    way = way if r["speed"] > ZERO else -way
    x, y, heading = roll(r["x"], r["y"], r["heading"], way, curvature(r["steer"], p["wheelbase"]))
    return x, y, heading, way


@kernel
def plan_to_goal(r, arcs, bodies, tries, most, p, floor, metric):
    """Begin the soonest manoeuvre found to the robot's goal; return the number of its arcs, NONE if there is none.

    Arguments: see rejoin.plan_to_route.
    """
    goals, rooms = np.empty((HEADINGS, 4), np.float32), np.empty(bodies.shape[0], np.float32)
    goals, shot = goals[: _write_goals(r, goals, p)], np.empty((MOST_ARCS, 2), np.float32)
    x, y, heading, way = _slowed_down(r, p)
    steer = r["steer"]
    s, c = sin_cos(r["heading"])
    for trial in range(tries):
        margin = manoeuvre.MARGINS[trial]
        write_rooms(r["x"], r["y"], c, s, margin, bodies, p, rooms)
        if not sweep_is_free(r["x"], r["y"], c, s, curvature(steer, p["wheelbase"]), way, margin, p, floor):
            continue
        count, _ = shoot(x, y, heading, steer, goals, margin, np.float32(np.inf), bodies, rooms, p, floor, shot)
        if count >= 0:
            first = 0
            if way != ZERO:
                arcs[0, 0], arcs[0, 1] = way, steer
                first = 1
            for k in range(count):
                arcs[first + k, 0], arcs[first + k, 1] = shot[k, 0], shot[k, 1]
            _dock(r, first + count, arcs, margin, p)
            return first + count
    if abs(r["speed"]) > _TURNING:  # it is driven from where the robot stands
        return manoeuvre.NONE
    for k in range(tries):
        trial = manoeuvre.trial_of(k, bodies)
        found = manoeuvre.search_exact(
            r["x"], r["y"], r["heading"], steer, goals, bodies, trial, most, p, floor, metric, arcs
        )
        if found >= 0:
            _dock(r, found, arcs, manoeuvre.MARGINS[trial], p)
            return found
        if found == manoeuvre.CUT_OFF and most < manoeuvre.MOST:
            break
    return manoeuvre.NONE


@kernel
def seek(begin, end, robots, routes, arcs, params, kinds, floor, metrics):
    """Search for all who seek their goal or their route in the worlds from `begin` to before `end`.

    Arguments: see step.advance and rejoin.seek.
    """
    p = params[0]
    near = np.empty((MOST_NEAR, BODY), np.float32)
    for b in range(begin, end):
        for i in range(robots.shape[1]):
            r, own = robots[b, i], kind_of(i, p, kinds)
            others, tries, most = take_up(i, robots[b], own, kinds, near)
            if others < 0:
                continue
            bodies, metric = near[:others], metrics[own["kind"]]
            if docks_from(r):
                r["docks"] = 0
                if plan_to_goal(r, arcs[b, i], bodies, tries, most, own, floor, metric) >= 0:
                    continue
            found = plan_to_route(r, routes[b, i], arcs[b, i], bodies, tries, most, own, floor, metric)
            if found == 0 and r["speed"] == ZERO:  # as near its route's end as that search gets it
                r["docks"], r["search_wait"] = 1, ZERO
