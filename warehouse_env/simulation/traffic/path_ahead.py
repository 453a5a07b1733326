"""The path ahead of a robot: poses of its body along its manoeuvre and then its route, as the follower will drive.

The poses stand at whole multiples of APART on the odometer (`distance`), so they stay in place while the robot drives:
a granted stretch is the same piece of floor in the next decision. A path is kept from one decision to the next, and
rewritten after two metres or when the robot leaves it.
"""

import numpy as np

from warehouse_env.kernel import inline, part, whole
from warehouse_env.simulation.driver.line import along_after, look_ahead, point_at, pursue, room_beside
from warehouse_env.simulation.physics.kinematics import curvature
from warehouse_env.simulation.physics.people import PACE, RADIUS, bars_ways, distance_to_body
from warehouse_env.simulation.physics.trigonometry import HALF, ZERO, sin_cos
from warehouse_env.simulation.state import NOBODY

POSES = 32  # of a path at most: 15.5 m; as many as there are bits
APART = np.float32(0.5)  # [m] of driving between two of them
CENTRE_X, CENTRE_Y, COS, SIN, DRIVEN = range(5)  # columns of a path; DRIVEN [m]: from here to there
COLUMNS = 5
_STRIDE = np.float32(0.125)  # [m] of driving in one step of the prediction
_FARTHEST = np.float32(16.0)  # [m] of driving looked at
_STEERED = np.float32(0.19)  # [rad] that the steering changes in a stride at 1 m/s
_SLOWEST, _FASTEST = np.float32(0.4), np.float32(1.2)  # [m/s] at which the follower's look-ahead is taken
_THERE = np.float32(0.3)  # [m] before its end at which a route through its goal is over
RENEWED = 2.0  # [m] of driving after which a path is written anew,
OFF, TURNED = np.float32(0.05), np.float32(0.15)  # [m] beside a pose just passed, or sine of the angle to it: too
_JOIN = 40  # way-points in which the route is searched for the end of a manoeuvre
ROOM_FOR_PEOPLE = np.float32(0.4)  # [m] before a person at which a grant ends: nearer, no robot gets out
_SOON = np.float32(1.0)  # [s] of a person's walk that count


@inline
def _put(path, k, x, y, heading, driven, p):
    """Write the body at a pose of its front axle, `driven` [m] ahead; return the number of poses then."""
    s, c = sin_cos(heading)
    path[k, CENTRE_X], path[k, CENTRE_Y] = x - p["offset"] * c, y - p["offset"] * s
    path[k, COS], path[k, SIN], path[k, DRIVEN] = c, s, driven
    return k + 1


@inline
def _drive(x, y, heading, way, bend):
    """Return the pose after `way` [m] along the chord of an arc of curvature `bend` [1/m]."""
    turn = way * bend
    s, c = sin_cos(heading + HALF * turn)
    return x + way * c, y + way * s, heading + turn


@part
def _along_arcs(r, arcs, to_next, path, p):
    """Write the poses along the rest of a manoeuvre; return (poses, to_next, driven [m], x, y, heading, steering) then.

    to_next [m]: to the next whole multiple of APART. The end of an arc is a pose of its own, whatever the odometer.
    """
    manoeuvre = r["manoeuvre"]
    x, y, heading, left = manoeuvre["arc_x"], manoeuvre["arc_y"], manoeuvre["arc_heading"], manoeuvre["arc_left"]
    driven, k, steer = ZERO, 1, r["motion"]["steer"]
    for n in range(manoeuvre["arc"], manoeuvre["arcs"]):
        left = left if n == manoeuvre["arc"] else arcs[n, 0]
        steer = arcs[n, 1]
        bend = curvature(steer, p["wheelbase"])
        while left != ZERO and k < POSES:
            stride = min(_STRIDE, to_next)
            way = min(max(left, -stride), stride)
            left -= way
            x, y, heading = _drive(x, y, heading, way, bend)
            driven += abs(way)
            to_next -= abs(way)
            if to_next <= ZERO:
                k, to_next = _put(path, k, x, y, heading, driven, p), APART
        if k < POSES and to_next < APART:
            k = _put(path, k, x, y, heading, driven, p)
    return k, to_next, driven, x, y, heading, steer


@inline
def _joins(r, route, x, y):
    """Return the position on its route [m] of a robot whose manoeuvre has ended at (x, y) [m]."""
    on_route = r["on_route"]
    best, at, first = np.float32(np.inf), on_route["position"], int(on_route["position"] / on_route["spacing"])
    for k in range(max(first - 1, 0), min(first + _JOIN, on_route["points"])):
        dx, dy = route[k, 0] - x, route[k, 1] - y
        if dx * dx + dy * dy < best:
            best, at = dx * dx + dy * dy, np.float32(k) * on_route["spacing"]
    return at


@inline
def steer_along(line, along, side, look, pose, p, floor):
    """Return the steering [rad] of the follower at `along` [m] of its route, with an offset `side` [m].

    line: (route, points, spacing, length [m]); pose: (x, y, cos, sin).
    """
    (route, points, spacing, end), (x, y, c, s) = line, pose
    tx, ty, ux, uy = point_at(route, points, spacing, min(along + look, end + p["beyond"]), p["beyond"])
    if side != ZERO:
        side = room_beside(tx, ty, ux, uy, side, end - along, floor, p)
    return pursue(x, y, c, s, tx - side * uy, ty + side * ux, p["wheelbase"], p["max_steer"])[0]


@inline
def _has_left(r, path, passed, gone, p):
    """Whether the robot is off its path: beside the pose passed last (if passed > 0), or farther than it has driven."""
    motion = r["motion"]
    cx, cy = motion["x"] - p["offset"] * motion["cos"], motion["y"] - p["offset"] * motion["sin"]
    dx, dy = cx - path[0, CENTRE_X], cy - path[0, CENTRE_Y]
    most = gone * p["swing"] + OFF
    if dx * dx + dy * dy > most * most:
        return True
    if passed == 0:
        return False
    c, s = path[passed, COS], path[passed, SIN]
    aside = (cy - path[passed, CENTRE_Y]) * c - (cx - path[passed, CENTRE_X]) * s
    return (
        abs(aside) > OFF
        or abs(motion["sin"] * c - motion["cos"] * s) > TURNED
        or motion["cos"] * c + motion["sin"] * s < ZERO
    )


@part
def keep_path(r, path, p):
    """Drop the poses of a path that the robot has passed since the last decision; False if it must be written anew."""
    motion, totals, traffic = r["motion"], r["totals"], r["traffic"]
    if r["task"]["alive"] == 0 or traffic["poses"] == 0 or totals["distance"] - traffic["path_from"] > RENEWED:
        return False
    gone = np.float32(totals["distance"] - traffic["path_at"])
    poses, passed = traffic["poses"], 0
    while passed + 1 < poses and path[passed + 1, DRIVEN] <= gone:
        passed += 1
    if poses - passed < 2 or _has_left(r, path, passed, gone, p):
        return False
    for k in range(1, poses - passed):
        for column in range(COLUMNS):
            path[k, column] = path[k + passed, column]
        path[k, DRIVEN] -= gone
    _put(path, whole(0), motion["x"], motion["y"], motion["heading"], ZERO, p)
    traffic["poses"], traffic["path_at"] = poses - passed, totals["distance"]
    return True


@inline
def begin_path(r, poses, at_end):
    """Record that a robot's path has been rewritten."""
    traffic = r["traffic"]
    traffic["poses"], traffic["at_end"] = poses, at_end
    traffic["path_from"] = traffic["path_at"] = r["totals"]["distance"]


@part
def write_path(r, route, arcs, side, many, p, floor, path):
    """Write the bodies at the robot's pose and ahead of it into a path; return (poses, at the end?).

    path float32[POSES, COLUMNS], of which at most `many` poses are written; side [m]: the lateral offset from the
    route. A manoeuvre that makes room (`retreating`) is the whole path.
    """
    motion, on_route = r["motion"], r["on_route"]
    _put(path, whole(0), motion["x"], motion["y"], motion["heading"], ZERO, p)
    if r["task"]["alive"] == 0 or on_route["points"] < 2:
        return 1, False
    apart = np.float64(APART)
    to_next = np.float32((np.floor(r["totals"]["distance"] / apart) + 1.0) * apart - r["totals"]["distance"])
    x, y, heading, steer, driven, k = motion["x"], motion["y"], motion["heading"], motion["steer"], ZERO, 1
    points, spacing, along = on_route["points"], on_route["spacing"], on_route["position"]
    if r["manoeuvre"]["arcs"] > 0:
        k, to_next, driven, x, y, heading, steer = _along_arcs(r, arcs, to_next, path, p)
        if r["traffic"]["retreating"] != 0 or k >= many:
            return k, False
        along = _joins(r, route, x, y)
    end = np.float32(points - 1) * spacing
    stops = p["beyond"] > ZERO
    over = end if stops else end - _THERE
    look = look_ahead(min(max(motion["speed"], _SLOWEST), _FASTEST), p)
    while k < many and driven < _FARTHEST:
        if along >= over:
            if stops and to_next < APART:
                k = _put(path, k, x, y, heading, driven, p)
            return k, True
        s, c = sin_cos(heading)
        wanted = steer_along((route, points, spacing, end), along, side, look, (x, y, c, s), p, floor)
        stride = min(_STRIDE, to_next)
        most = _STEERED * stride / _STRIDE
        steer = min(max(wanted, steer - most), steer + most)
        x, y, heading = _drive(x, y, heading, stride, curvature(steer, p["wheelbase"]))
        driven += stride
        to_next -= stride
        along = along_after(route, points, spacing, along, stride, x, y)
        if to_next <= ZERO:
            k, to_next = _put(path, k, x, y, heading, driven, p), APART
    return k, False


@inline
def _to_person(x, y, pose, p):
    """Return the gap [m] between a body at a pose of a path and a person at (x, y) [m]."""
    return distance_to_body(x, y, pose[CENTRE_X], pose[CENTRE_Y], pose[COS], pose[SIN], p) - RADIUS


@inline
def before_people(path, must, granted, persons, p):
    """Return (the last pose of a grant before a person PERSON[M] or where one soon will be, that person or NOBODY).

    A robot that is near already may go on as long as it comes no nearer. must: the pose before which it cannot stop.
    """
    person = NOBODY
    reach = p["swing"] * (path[granted, DRIVEN] - path[must, DRIVEN]) + p["radius"] + RADIUS + ROOM_FOR_PEOPLE
    reach += PACE * _SOON
    for m in range(persons.shape[0]):
        o = persons[m]
        dx, dy = o["x"] - path[must, CENTRE_X], o["y"] - path[must, CENTRE_Y]
        if dx * dx + dy * dy > reach * reach:
            continue
        walks = PACE * _SOON if o["rest"] == ZERO and not bars_ways(o) else ZERO
        for x, y in ((o["x"], o["y"]), (o["x"] + walks * o["cos"], o["y"] + walks * o["sin"])):
            before = _to_person(x, y, path[must], p)
            for k in range(must + 1, granted + 1):
                gap = _to_person(x, y, path[k], p)
                if gap < ROOM_FOR_PEOPLE and gap < before:
                    granted, person = k - 1, m
                    break
    return granted, person
