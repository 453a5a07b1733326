"""The robot on its route: its position, the points ahead, and pure pursuit towards one of them.

The path follower (tracking.py) drives by these functions, and right of way predicts by them (traffic/path_ahead.py).
They must stay the same, or grants would not match the motion.
"""

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.physics.footprint import clearance_at
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, arc_tan, arc_tan2, wrap

TWO = np.float32(2.0)
# lengths are those of the default body, in proportion for others (length_scale and width_scale of state.PARAMETERS)
LOOK_AHEAD = np.float32(0.55)  # [m] standing
LOOK_AHEAD_TIME = np.float32(0.45)  # [s] of driving added to it
LANE_CLEARANCE = np.float32(0.45)  # [m] a way-point moved sideways keeps from shelves
OFFSET_FADE = np.float32(2.0)  # [m] before the goal in which offsets fade out


@inline
def locate(r, route):
    """Project the robot onto its route near where it was; update position, lateral and bearing; return progress [m]."""
    motion, on_route = r["motion"], r["on_route"]
    points = on_route["points"]
    spacing = on_route["spacing"]
    x, y = motion["x"], motion["y"]
    before = on_route["position"]
    if points < 2:
        on_route["lateral"] = ZERO
        on_route["bearing"] = ZERO
        return ZERO
    first = max(int(before / spacing) - 1, 0)
    first = min(first, points - 2)
    last = min(first + 6, points - 2)
    inverse = ONE / spacing
    best = np.float32(np.inf)
    nearest = first
    reached = ZERO
    for k in range(first, last + 1):
        ax, ay = route[k, 0], route[k, 1]
        ux, uy = (route[k + 1, 0] - ax) * inverse, (route[k + 1, 1] - ay) * inverse
        along = (x - ax) * ux + (y - ay) * uy
        along = min(max(along, ZERO), spacing)
        dx, dy = x - (ax + along * ux), y - (ay + along * uy)
        squared = dx * dx + dy * dy
        if squared < best:
            best = squared
            nearest = k
            reached = along
    ax, ay = route[nearest, 0], route[nearest, 1]
    ux, uy = (route[nearest + 1, 0] - ax) * inverse, (route[nearest + 1, 1] - ay) * inverse
    on_route["position"] = np.float32(nearest) * spacing + reached
    on_route["lateral"] = ux * (y - ay) - uy * (x - ax)
    on_route["bearing"] = wrap(arc_tan2(uy, ux) - motion["heading"])
    return on_route["position"] - before


@inline
def to_go(r):
    """Return the metres left of a robot's route."""
    on_route = r["on_route"]
    return np.float32(max(on_route["points"] - 1, 0)) * on_route["spacing"] - on_route["position"]


@inline
def point_at(route, points, spacing, along, beyond):
    """Return the point `along` [m] a route of at least 2 points and its direction (x, y, ux, uy).

    It lies `beyond` its end at most, straight on: in spacings, for 0 and infinity alike in metres.
    """
    at = along / spacing
    k = min(int(at), points - 2)
    part = min(at - np.float32(k), ONE + beyond)
    dx, dy = route[k + 1, 0] - route[k, 0], route[k + 1, 1] - route[k, 1]
    return route[k, 0] + part * dx, route[k, 1] + part * dy, dx / spacing, dy / spacing


@inline
def along_after(route, points, spacing, along, way, x, y):
    """Return how far along a route [m] a robot at (x, y) [m] is that drove `way` [m] from `along`."""
    k = min(int(along / spacing), points - 2)
    ux, uy = (route[k + 1, 0] - route[k, 0]) / spacing, (route[k + 1, 1] - route[k, 1]) / spacing
    reached = np.float32(k) * spacing + (x - route[k, 0]) * ux + (y - route[k, 1]) * uy
    return min(max(reached, along), along + TWO * max(way, ZERO))


@inline
def way_point(r, route, ahead, beyond):
    """Return the route's point `ahead` [m] of the robot and its direction (x, y, ux, uy); `beyond` the goal at most."""
    on_route = r["on_route"]
    if on_route["points"] < 2:
        return r["task"]["goal_x"], r["task"]["goal_y"], ONE, ZERO
    return point_at(route, on_route["points"], on_route["spacing"], on_route["position"] + ahead, beyond)


@inline
def look_ahead(speed, p):
    """Return how far ahead [m] the point lies that is steered for at a speed [m/s]."""
    return LOOK_AHEAD * p["length_scale"] + LOOK_AHEAD_TIME * speed


@inline
def room_beside(tx, ty, ux, uy, offset, left, floor, p):
    """Return the part of the lateral offset `offset` [m] that fits at a point of the route.

    ux, uy: the route's direction there; left [m]: of the route, at the end of which it fades out.
    """
    offset *= min(ONE, left / (OFFSET_FADE * p["length_scale"]))
    least = LANE_CLEARANCE * p["width_scale"]
    if clearance_at(tx - offset * uy, ty + offset * ux, floor) < least:
        offset *= HALF
        if clearance_at(tx - offset * uy, ty + offset * ux, floor) < least:
            offset = ZERO
    return offset


@inline
def to_steering(bend, wheelbase, most):
    """Return the rear-wheel angle [rad] that drives a curvature [1/m], within +-most."""
    return min(max(-arc_tan(wheelbase * bend), -most), most)


@inline
def pursue(x, y, c, s, tx, ty, wheelbase, most):
    """Return (steering [rad], [m] ahead, [m] left) of pure pursuit from (x, y) [m], heading (c, s), to (tx, ty) [m].

    most [rad]: the largest steering angle.
    """
    dx, dy = tx - x, ty - y
    ahead, left = dx * c + dy * s, dy * c - dx * s
    bend = TWO * left / max(ahead * ahead + left * left, np.float32(0.01))
    steer = to_steering(bend, wheelbase, most)
    if ahead <= ZERO:
        steer = -most if left >= ZERO else most
    return steer, ahead, left


@inline
def steer_for(r, tx, ty, p):
    """Return (steering [rad], angle to the target [rad]) of the robot's pure pursuit towards (tx, ty) [m]."""
    motion = r["motion"]
    x, y, c, s = motion["x"], motion["y"], motion["cos"], motion["sin"]
    steer, ahead, left = pursue(x, y, c, s, tx, ty, p["wheelbase"], p["max_steer"])
    return steer, arc_tan2(left, ahead)


@inline
def aim(r, route, p):
    """Set follow_steer towards a point of the route ahead; return that, the direction there, and the angle to it."""
    tx, ty, ux, uy = way_point(r, route, look_ahead(max(r["motion"]["speed"], ZERO), p), p["beyond"])
    r["commanded"]["follow_steer"], angle = steer_for(r, tx, ty, p)
    return tx, ty, ux, uy, angle


@inline
def forget_path(r):
    """Have right of way write the robot's path anew, since it leads elsewhere; what has been granted stays so."""
    r["traffic"]["poses"] = 0


@inline
def forget_grants(r):
    """Have right of way write the robot's path anew and grant it from nothing: what was granted was of another."""
    r["traffic"]["claim"], r["traffic"]["poses"] = 0.0, 0
