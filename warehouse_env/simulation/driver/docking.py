"""Docking: the manoeuvre to a goal's exact pose, of robots that stop at their goals.

A single shot from where the robot will have slowed down (shots.py); if none is free, a slow robot runs a search that
ends with a shot. driving.py drives the result. Who searches when: traffic/recovery.py.
"""

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.driver.arrival import BRAKING
from warehouse_env.simulation.driver.bodies import write_rooms
from warehouse_env.simulation.driver.driving import begin as begin_manoeuvre
from warehouse_env.simulation.driver.manoeuvre import MARGINS, NONE, put_goal
from warehouse_env.simulation.driver.shots import shoot
from warehouse_env.simulation.physics.footprint import sweep_is_free
from warehouse_env.simulation.physics.geometry import pose_at
from warehouse_env.simulation.physics.kinematics import curvature, roll
from warehouse_env.simulation.physics.trigonometry import HALF, HALF_PI, PI, ZERO, sin_cos, wrap

HEADINGS = 4  # tried where any heading will do
TURNING = np.float32(0.2)  # [m/s] up to which a robot can take any turn


@inline
def write_goals(r, goals, p):
    """Write the robot's goal into goals float32[HEADINGS, GOAL], for each heading that is tried; return how many."""
    task = r["task"]
    free = np.isnan(task["goal_heading"])
    for k in range(HEADINGS):
        heading = wrap(r["motion"]["heading"] + np.float32(k) * HALF_PI) if free else task["goal_heading"]
        put_goal(goals, k, task["goal_x"], task["goal_y"], heading, ZERO)
    if task["either"] == 0:
        return HEADINGS if free else 1
    x, y, heading = _other_way_round(r, p)
    put_goal(goals, 1, x, y, heading, ZERO)
    return 2


@inline
def _other_way_round(r, p):
    """Return the pose (x, y, heading) that puts the body in its place at the goal, the other way round."""
    task = r["task"]
    s, c = sin_cos(task["goal_heading"])
    between = p["offset"] + p["offset"]
    return task["goal_x"] - between * c, task["goal_y"] - between * s, wrap(task["goal_heading"] + PI)


@inline
def begin_docking(r, count, arcs, margin, p):
    """Begin the manoeuvre of `count` arcs to the robot's goal; it decides which way round the robot will stand."""
    task = r["task"]
    begin_manoeuvre(r, count, arcs, margin)
    r["manoeuvre"]["docks"] = 1
    if task["either"] == 0:
        return
    heading = r["motion"]["heading"]
    for k in range(count):
        heading = wrap(heading + wrap(arcs[k, 0] * curvature(arcs[k, 1], p["wheelbase"])))
    if abs(wrap(heading - task["goal_heading"])) > HALF_PI:
        task["goal_x"], task["goal_y"], task["goal_heading"] = _other_way_round(r, p)


@inline
def _slowed_down(r, p):
    """Return (pose x, y, heading, metres to it) at which a robot that brakes now has slowed down enough to turn."""
    motion = r["motion"]
    way = max(motion["speed"] * motion["speed"] - TURNING * TURNING, ZERO) * HALF / (BRAKING * p["max_acceleration"])
    way = way if motion["speed"] > ZERO else -way
    x, y, heading = roll(motion["x"], motion["y"], motion["heading"], way, curvature(motion["steer"], p["wheelbase"]))
    return x, y, heading, way


@part
def shoot_ahead(r, query, arcs):
    """Write a single shot to the goal of robot r; return (number of arcs, margin [m]), NONE arcs if none is free."""
    around, steer, shot = query.around, query.steer, query.scratch.shot
    x, y, heading, way = _slowed_down(r, around.p)
    ahead, bend = pose_at(x, y, heading), curvature(steer, around.p["wheelbase"])
    for trial in range(query.tries):
        margin = MARGINS[trial]
        write_rooms(query.pose, margin, around)
        if not sweep_is_free(query.pose, bend, way, margin, around.p, around.floor):
            continue
        count, _ = shoot(ahead, steer, query.near, margin, np.float32(np.inf), around, shot)
        if count < 0:
            continue
        first = 0
        if way != ZERO:
            arcs[0, 0], arcs[0, 1] = way, steer
            first = 1
        for k in range(count):
            arcs[first + k, 0], arcs[first + k, 1] = shot[k, 0], shot[k, 1]
        return first + count, margin
    return NONE, ZERO
