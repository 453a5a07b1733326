"""Drive the arcs of a manoeuvre: a reference pose moves along them, and the robot is steered back to it.

`begin(r, count, arcs, margin)` starts the manoeuvre in arcs float32[ARCS, 2] (manoeuvre.py), and `give_up(r)` ends it.
While a robot is in one, its `arcs` field is above 0. `drive_arcs` returns (speed, steering) of the next step until the
manoeuvre is done, or gives it up if the robot was pushed off it. A manoeuvre that `docks` ends exactly at the goal:
where robots stop at goals (`stopping`, step.Features), the robot stands at its end and drives straight arcs at full
speed.
"""

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.driver.arrival import BRAKING, speed_before
from warehouse_env.simulation.driver.line import forget_grants, forget_path, to_steering
from warehouse_env.simulation.physics.kinematics import curvature, roll
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, arc_tan2, sin_cos, wrap

FASTEST, FASTEST_BACK = np.float32(0.8), np.float32(0.5)  # [m/s] on arcs
STEER_SLACK = np.float32(0.2)  # [rad m/s]: how fast times how far off the wanted steering angle
READY = np.float32(0.02)  # [m] before the end of an arc that count as its end
NARROW = np.float32(1e-3)  # [m] of margin under which it drives exactly: it steers while standing, and ends arcs
EXACT, EXACT_STEER = np.float32(0.001), np.float32(0.001)  # within so many [m] and [rad]
STANDS = np.float32(0.06)  # [m/s] under which the other direction may be taken
BACK_TO_ARC = np.float32(9.0)  # [1/m^2] of curvature per metre beside the arc, and
ALONG_ARC = np.float32(6.0)  # [1/m] per radian off its direction: critically damped after a third of a metre
LOST, LOST_TURN = np.float32(0.15), np.float32(0.35)  # [m], [rad] off the reference at which it is given up
KEPT = np.float32(1.0 / 3.0)  # of the planned margin that is kept when driving
# [m/s] when docking with so narrow a margin: between two samples a corner leaves its chord by 1e-5 m
GRAZING = np.float32(0.1)
EXACT_END = np.float32(0.003)  # [m] before the end of a manoeuvre that docks, and before it turns back
SLACK_PER_METRE = np.float32(0.2)  # [rad/s] of STEER_SLACK for each metre of a docking arc
LEAST_OFF = np.float32(0.01)  # [rad]
_STRAIGHT = np.float32(1e-3)  # [1/m]
_TWO = np.float32(2.0)


@inline
def give_up(r):
    """End the robot's manoeuvre where it is."""
    r["manoeuvre"]["arcs"] = 0
    forget_path(r)


@inline
def begin(r, count, arcs, margin):
    """Start a manoeuvre of `count` arcs, planned with `margin` [m], from where the robot stands."""
    motion, manoeuvre = r["motion"], r["manoeuvre"]
    manoeuvre["arc_margin"] = manoeuvre["arc_planned"] = margin * KEPT
    manoeuvre["arcs"], manoeuvre["arc"], manoeuvre["docks"] = count, 0, 0
    forget_grants(r)
    manoeuvre["arc_x"], manoeuvre["arc_y"], manoeuvre["arc_heading"] = motion["x"], motion["y"], motion["heading"]
    manoeuvre["arc_left"] = arcs[0, 0] if count > 0 else ZERO


@inline
def leads_ahead(r, arcs):
    """Whether the robot is in a manoeuvre all of whose arcs to come lead forwards."""
    manoeuvre = r["manoeuvre"]
    for k in range(manoeuvre["arc"], manoeuvre["arcs"]):
        if arcs[k, 0] < ZERO:
            return False
    return manoeuvre["arcs"] > 0


@inline
def _slide(r, arcs, p):
    """Move the reference pose to where the robot is along its arc; return (metres left of it, radians left of it)."""
    motion, manoeuvre = r["motion"], r["manoeuvre"]
    bend = curvature(arcs[manoeuvre["arc"], 1], p["wheelbase"])
    s, c = sin_cos(manoeuvre["arc_heading"])
    dx, dy = motion["x"] - manoeuvre["arc_x"], motion["y"] - manoeuvre["arc_y"]
    along = dx * c + dy * s
    if abs(bend) > _STRAIGHT:
        along = arc_tan2(bend * along, ONE - bend * (dy * c - dx * s)) / bend
    left = manoeuvre["arc_left"]
    along = min(max(along, ZERO), left) if left > ZERO else max(min(along, ZERO), left)
    half = HALF * along * bend
    chord = along if abs(bend) <= _STRAIGHT else _TWO * sin_cos(half)[0] / bend
    s, c = sin_cos(manoeuvre["arc_heading"] + half)
    manoeuvre["arc_x"] += chord * c
    manoeuvre["arc_y"] += chord * s
    manoeuvre["arc_heading"] = wrap(manoeuvre["arc_heading"] + half + half)
    manoeuvre["arc_left"] = left - along
    s, c = sin_cos(manoeuvre["arc_heading"])
    dx, dy = motion["x"] - manoeuvre["arc_x"], motion["y"] - manoeuvre["arc_y"]
    return dy * c - dx * s, wrap(motion["heading"] - manoeuvre["arc_heading"])


@inline
def _next_arc(r, arcs):
    """Begin the next arc at the end of one; if it leads the other way, once the robot stands."""
    manoeuvre = r["manoeuvre"]
    ready = EXACT if manoeuvre["arc_margin"] < NARROW else READY
    while manoeuvre["arcs"] > 0 and abs(manoeuvre["arc_left"]) < ready:
        following = manoeuvre["arc"] + 1
        if following == manoeuvre["arcs"]:
            manoeuvre["arcs"] = 0
        elif arcs[following, 0] * arcs[manoeuvre["arc"], 0] < ZERO and abs(r["motion"]["speed"]) > STANDS:
            return
        else:
            manoeuvre["arc"] = following
            manoeuvre["arc_left"] = arcs[following, 0]


@inline
def _speed_limit(r, arcs, p):
    """Return the speed [m/s] from which the robot can still stop or steer as the arcs ahead require."""
    manoeuvre = r["manoeuvre"]
    k, count = int(manoeuvre["arc"]), int(manoeuvre["arcs"])
    forward = arcs[k, 0] > ZERO
    limit = FASTEST if forward else FASTEST_BACK
    run, slowing = abs(manoeuvre["arc_left"]), _TWO * BRAKING * p["max_acceleration"]
    if manoeuvre["arc_margin"] < NARROW:
        return min(limit, np.sqrt(slowing * run), run / p["time_step"])
    while k + 1 < count:
        at_end = ZERO
        if arcs[k, 0] * arcs[k + 1, 0] > ZERO:
            at_end = STEER_SLACK / max(abs(arcs[k + 1, 1] - arcs[k, 1]), STEER_SLACK)
        limit = min(limit, np.sqrt(at_end * at_end + slowing * max(run - HALF * READY, ZERO)))
        if at_end == ZERO:
            return limit
        k += 1
        run += abs(arcs[k, 0])
    return limit if forward else min(limit, np.sqrt(slowing * run))


@inline
def _next_arc_exactly(r, arcs, p):
    """Begin the next arc in a manoeuvre that docks: it starts exactly at the end of the last one."""
    manoeuvre = r["manoeuvre"]
    while manoeuvre["arcs"] > 0:
        k, following = manoeuvre["arc"], manoeuvre["arc"] + 1
        turns_back = following == manoeuvre["arcs"] or arcs[following, 0] * arcs[k, 0] < ZERO
        if abs(manoeuvre["arc_left"]) >= (EXACT_END if turns_back else READY) or (
            turns_back and abs(r["motion"]["speed"]) > STANDS
        ):
            return
        if following == manoeuvre["arcs"]:
            manoeuvre["arcs"] = 0
            return
        bend = curvature(arcs[k, 1], p["wheelbase"])
        manoeuvre["arc_x"], manoeuvre["arc_y"], manoeuvre["arc_heading"] = roll(
            manoeuvre["arc_x"], manoeuvre["arc_y"], manoeuvre["arc_heading"], manoeuvre["arc_left"], bend
        )
        manoeuvre["arc"], manoeuvre["arc_left"] = following, arcs[following, 0]


@inline
def _docking_speed(r, arcs, off, p):
    """Return the speed [m/s] of a manoeuvre that docks; off [rad]: steering error.

    The robot stops at the end and at each change of direction. Before short arcs it steers more while standing.
    """
    manoeuvre = r["manoeuvre"]
    k, count = int(manoeuvre["arc"]), int(manoeuvre["arcs"])
    forward = arcs[k, 0] > ZERO
    limit = FASTEST if forward else FASTEST_BACK
    if arcs[k, 1] == ZERO:
        limit = p["max_speed"] if forward else -p["min_speed"]
    if manoeuvre["arc_margin"] < NARROW:
        limit = GRAZING
    limit = min(limit, _slack(arcs[k, 0]) / max(off, LEAST_OFF))
    run = abs(manoeuvre["arc_left"])
    while k + 1 < count and arcs[k, 0] * arcs[k + 1, 0] > ZERO:
        at_end = _slack(arcs[k + 1, 0]) / max(abs(arcs[k + 1, 1] - arcs[k, 1]), LEAST_OFF)
        limit = min(limit, speed_before(max(run - HALF * READY, ZERO), at_end, r["motion"]["speed"], p))
        k += 1
        run += abs(arcs[k, 0])
    return min(limit, speed_before(run, ZERO, r["motion"]["speed"], p), run / p["time_step"])


@inline
def _slack(length):
    """Return the largest product of speed and steering error [rad m/s] on an arc of a length [m]."""
    return min(STEER_SLACK, SLACK_PER_METRE * abs(length))


@part
def drive_arcs(r, arcs, wanted, stopping, p):
    """Return the (speed [m/s], steering [rad]) that follow the arcs at `wanted` [m/s] >= 0 at most.

    r["manoeuvre"]["arcs"] is 0 afterwards if the manoeuvre is over; what is returned then is not to be used.
    """
    manoeuvre = r["manoeuvre"]
    lateral, turned = _slide(r, arcs, p)
    if abs(lateral) > LOST or abs(turned) > LOST_TURN:
        give_up(r)
    docks = stopping is not None and manoeuvre["docks"] != 0
    if docks:
        _next_arc_exactly(r, arcs, p)
    else:
        _next_arc(r, arcs)
    if manoeuvre["arcs"] == 0:
        return ZERO, ZERO
    k = manoeuvre["arc"]
    direction = ONE if arcs[k, 0] > ZERO else -ONE
    back, along = BACK_TO_ARC / (p["length_scale"] * p["length_scale"]), ALONG_ARC / p["length_scale"]
    bend = curvature(arcs[k, 1], p["wheelbase"]) - back * lateral - direction * along * turned
    steer = to_steering(bend, p["wheelbase"], p["max_steer"])
    off = abs(steer - r["motion"]["steer"])
    if docks:
        speed = _docking_speed(r, arcs, off, p)
    else:
        speed = min(_speed_limit(r, arcs, p), STEER_SLACK / max(off, LEAST_OFF))
    if manoeuvre["arc_margin"] < NARROW and off > EXACT_STEER and abs(r["motion"]["speed"]) < STANDS:
        speed = ZERO
    return direction * min(speed, wanted), steer
