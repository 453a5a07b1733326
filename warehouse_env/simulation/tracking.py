"""The path follower under every discrete and continuous action: pure pursuit that respects the swept body.

An action asks for a speed and a lateral offset from the route. The follower steers towards a point ahead
(pure pursuit about the fixed front axle), slows down where it must steer, and takes a command only if the
body, driven on and then braked, stays off the shelves: the map is known, so this needs no learning. Where it
cannot go on forwards (a turn in a narrow aisle) it backs out with the opposite lock, as a driver would.
Other robots are not its business.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.simulation.footprint import clearance_at, sweep_is_free
from warehouse_env.simulation.kernel import inline, kernel
from warehouse_env.simulation.kinematics import approach, curvature
from warehouse_env.simulation.trigonometry import HALF, ONE, ZERO, arc_tan, arc_tan2, wrap

TWO = np.float32(2.0)
LOOK_AHEAD = np.float32(0.55)  # [m] standing
LOOK_AHEAD_TIME = np.float32(0.45)  # [s] of driving added to it
CREEP = np.float32(0.35)  # [m/s] in the sharpest turns
SLOW = np.float32(0.45)  # [m/s] under which another steering angle may be chosen
BEND_SCALE = np.float32(0.9)  # [rad] of steering at which the speed has come down to a creep
MARGIN = np.float32(0.03)  # [m] the follower keeps from shelves
TIGHT = np.float32(0.015)  # [m] when it creeps off a shelf that it has come too near
LAST = np.float32(0.002)  # [m] when even that leaves no way
LANE_CLEARANCE = np.float32(0.45)  # [m] a way-point moved sideways keeps from shelves
OFFSET_FADE = np.float32(2.0)  # [m] before the goal in which offsets fade out
BACK_OUT = np.float32(0.8)  # [m] at most in one go
BACK_SPEED = np.float32(-0.35)  # [m/s]
CREEP_HORIZON = np.float32(0.12)  # [m] that must be free to creep on
TURN_HORIZON = np.float32(0.7)  # [m] of an arc that must be free to turn round on it
LEAST_TURN = np.float32(0.3)  # [rad] of steering without which it is no turn
ASIDE = np.float32(1.0)  # [rad] off the nose from which a target takes a turn on the spot
BEHIND = np.float32(2.2)  # [rad] off the nose from which it is better to back out than to drive on
PATIENCE = np.float32(8.0)  # [s] without a metre of progress until another way is tried
READY = np.float32(0.25)  # [rad] of steering error with which creeping begins
FORWARD, ANYWHERE, BACKWARD = 1, 2, -1  # gears; ANYWHERE: forward, with whatever steering is free
_TRY_STEP = np.float32(0.175)  # [rad] between the steering angles tried when the wanted one is blocked


@inline
def locate(r, route):  # type: ignore[no-untyped-def]
    """Project the robot onto its route near where it was; update position, lateral and bearing; return progress [m]."""
    points = r["points"]
    spacing = r["spacing"]
    x, y = r["x"], r["y"]
    before = r["position"]
    if points < 2:
        r["lateral"] = ZERO
        r["bearing"] = ZERO
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
    r["position"] = np.float32(nearest) * spacing + reached
    r["lateral"] = ux * (y - ay) - uy * (x - ax)
    r["bearing"] = wrap(arc_tan2(uy, ux) - r["heading"])
    return r["position"] - before


@inline
def way_point(r, route, ahead):  # type: ignore[no-untyped-def]
    """Return the route's point `ahead` [m] of the robot and its direction (x, y, ux, uy); the goal at most."""
    points = r["points"]
    if points < 2:
        return r["goal_x"], r["goal_y"], ONE, ZERO
    spacing = r["spacing"]
    at = (r["position"] + ahead) / spacing
    k = min(int(at), points - 2)
    part = min(at - np.float32(k), ONE)
    dx, dy = route[k + 1, 0] - route[k, 0], route[k + 1, 1] - route[k, 1]
    return route[k, 0] + part * dx, route[k, 1] + part * dy, dx / spacing, dy / spacing


@inline
def to_steering(bend, wheelbase, most):  # type: ignore[no-untyped-def]
    """Return the rear-wheel angle [rad] that drives a curvature [1/m], within +-most."""
    return min(max(-arc_tan(wheelbase * bend), -most), most)


@inline
def pursue(r, tx, ty, p):  # type: ignore[no-untyped-def]
    """Return (steering [rad], angle to the target [rad]) of pure pursuit towards (tx, ty) [m]."""
    dx, dy = tx - r["x"], ty - r["y"]
    ahead = dx * r["cos"] + dy * r["sin"]
    left = dy * r["cos"] - dx * r["sin"]
    angle = arc_tan2(left, ahead)
    if ahead <= ZERO:
        return (-p["max_steer"] if left >= ZERO else p["max_steer"]), angle
    squared = ahead * ahead + left * left
    bend = TWO * left / max(squared, np.float32(0.01))
    return to_steering(bend, p["wheelbase"], p["max_steer"]), angle


@kernel
def _is_free(r, speed, steer, least, margin, p, solid, clearance):  # type: ignore[no-untyped-def]
    """Whether one step at `speed` with `steer` and then full braking, at least `least` [m], keeps off the shelves."""
    distance = abs(speed) * p["time_step"] + HALF * speed * speed / p["max_acceleration"]
    distance = max(distance, least)
    bend = curvature(steer, p["wheelbase"])
    signed = distance if speed >= ZERO else -distance
    return sweep_is_free(r["x"], r["y"], r["cos"], r["sin"], bend, signed, margin, p, solid, clearance)


@kernel
def _steer_free(r, wanted, speed, most_shift, horizon, margin, p, solid, clearance):  # type: ignore[no-untyped-def]
    """Return (found, the angle nearest to `wanted`, within most_shift, whose arc is free for `horizon` [m])."""
    tries = int(most_shift / _TRY_STEP)
    sign = ONE if wanted <= ZERO else -ONE  # first towards straight ahead
    for k in range(2 * tries + 1):
        shift = np.float32((k + 1) // 2) * _TRY_STEP * (sign if k % 2 == 1 else -sign)
        steer = wanted + shift
        if abs(steer) <= p["max_steer"] and _is_free(r, speed, steer, horizon, margin, p, solid, clearance):
            return True, steer
    return False, wanted


@inline
def _attempt(r):  # type: ignore[no-untyped-def]
    """What to try next, the longer a robot has not advanced: 0 as usual, 1 back further, 2 turn the other way."""
    return int(r["stalled_time"] / PATIENCE) % 3


@inline
def _brake_steer(r, steer, p, solid, clearance):  # type: ignore[no-untyped-def]
    """The steering angle to brake with: the wanted one if its sweep is free, else the present one, free before."""
    dt = p["time_step"]
    next_steer = approach(r["steer"], steer, p["max_steer_rate"] * dt)
    slower = approach(r["speed"], ZERO, p["max_acceleration"] * dt)
    if r["speed"] == ZERO:
        return steer
    return steer if _is_free(r, slower, next_steer, ZERO, MARGIN, p, solid, clearance) else r["steer"]


@inline
def _back_out(r, angle, p, solid, clearance):  # type: ignore[no-untyped-def]
    """Reverse so that the nose turns towards the target; return (speed, steering)."""
    most = p["max_steer"]
    wanted = min(max(TWO * angle, -most), most)
    r["gear_distance"] += r["speed"] * p["time_step"]
    backed = BACK_OUT * (ONE + np.float32(_attempt(r))) - r["gear_distance"]
    found, steer = _steer_free(r, wanted, BACK_SPEED, most, TURN_HORIZON, MARGIN, p, solid, clearance)
    if not found:
        found, steer = _steer_free(r, wanted, BACK_SPEED, TWO * most, CREEP_HORIZON, TIGHT, p, solid, clearance)
    if not found:
        r["gear"] = ANYWHERE if backed < CREEP_HORIZON else FORWARD
        return ZERO, _brake_steer(r, wanted, p, solid, clearance)
    if r["gear_distance"] <= ZERO:
        r["gear"] = ANYWHERE
    elif backed > CREEP_HORIZON:
        turns, _ = _steer_free(r, -wanted, CREEP, most - LEAST_TURN, TURN_HORIZON, MARGIN, p, solid, clearance)
        if turns:
            r["gear"] = FORWARD
    if abs(steer - r["steer"]) < READY:
        return BACK_SPEED, steer
    return ZERO, _brake_steer(r, steer, p, solid, clearance)


@inline
def _forward(r, speed, steer, angle, p, solid, clearance):  # type: ignore[no-untyped-def]
    """Return the (speed, steering) nearest to the wanted ones whose sweep is free; shift to reverse if none is."""
    dt = p["time_step"]
    slow = r["speed"] < SLOW
    aside = abs(angle) > ASIDE
    next_steer = approach(r["steer"], steer, p["max_steer_rate"] * dt)
    if not (slow and aside):
        next_speed = approach(r["speed"], speed, p["max_acceleration"] * dt)
        if _is_free(r, next_speed, next_steer, ZERO, MARGIN, p, solid, clearance):
            if not slow:
                r["gear"] = FORWARD
            return speed, steer
    if not slow:
        return ZERO, _brake_steer(r, steer, p, solid, clearance)
    # a target aside or behind: the sharpest arc that the tail can finish, not one that ends at the wall
    found = False
    free = steer
    if aside:
        most_shift = p["max_steer"] - LEAST_TURN
        found, free = _steer_free(r, steer, CREEP, most_shift, TURN_HORIZON, MARGIN, p, solid, clearance)
    if not found and (abs(angle) < BEHIND or r["gear"] == ANYWHERE):
        found, free = _steer_free(r, steer, CREEP, TWO * p["max_steer"], CREEP_HORIZON, TIGHT, p, solid, clearance)
        if not found and r["gear"] == ANYWHERE:
            found, free = _steer_free(r, steer, CREEP, TWO * p["max_steer"], CREEP_HORIZON, LAST, p, solid, clearance)
    if not found:
        r["gear"] = BACKWARD
        r["gear_distance"] = BACK_OUT * (ONE + np.float32(_attempt(r)))
        return ZERO, _brake_steer(r, steer, p, solid, clearance)
    if abs(free - r["steer"]) < READY:
        return min(speed, CREEP), free
    return ZERO, _brake_steer(r, free, p, solid, clearance)


@inline
def _backwards(r, speed, p, solid, clearance):  # type: ignore[no-untyped-def]
    """Return (speed, steering) of backing with the nose along the route, or of stopping before a shelf."""
    steer = min(max(r["bearing"], -p["max_steer"]), p["max_steer"])
    next_steer = approach(r["steer"], steer, p["max_steer_rate"] * p["time_step"])
    next_speed = approach(r["speed"], speed, p["max_acceleration"] * p["time_step"])
    if _is_free(r, next_speed, next_steer, ZERO, MARGIN, p, solid, clearance):
        return speed, steer
    return ZERO, _brake_steer(r, steer, p, solid, clearance)


@inline
def follow(r, route, wanted_speed, offset, p, solid, clearance):  # type: ignore[no-untyped-def]
    """Set target_speed, target_steer and follow_steer from a wanted speed [m/s] and lateral offset [m]."""
    ahead = LOOK_AHEAD + LOOK_AHEAD_TIME * max(r["speed"], ZERO)
    tx, ty, ux, uy = way_point(r, route, ahead)
    r["follow_steer"], angle = pursue(r, tx, ty, p)
    steer = r["follow_steer"]
    if offset != ZERO:
        to_go = np.float32(r["points"] - 1) * r["spacing"] - r["position"]
        offset *= min(ONE, to_go / OFFSET_FADE)
        if clearance_at(tx - offset * uy, ty + offset * ux, clearance, p["cell"]) < LANE_CLEARANCE:
            offset *= HALF
            if clearance_at(tx - offset * uy, ty + offset * ux, clearance, p["cell"]) < LANE_CLEARANCE:
                offset = ZERO
        steer, angle = pursue(r, tx - offset * uy, ty + offset * ux, p)
    if abs(angle) > ASIDE and _attempt(r) == 2:
        steer, angle = -steer, -angle
    speed = wanted_speed
    if speed > ZERO:
        if r["gear"] < 0:
            speed, steer = _back_out(r, angle, p, solid, clearance)
        else:
            bend = max(abs(steer), abs(steer - r["steer"])) / BEND_SCALE
            limit = CREEP + (p["max_speed"] - CREEP) * max(ZERO, ONE - bend)
            speed, steer = _forward(r, min(speed, limit), steer, angle, p, solid, clearance)
    elif r["speed"] > ZERO or speed == ZERO:
        steer = _brake_steer(r, steer, p, solid, clearance)
    else:
        speed, steer = _backwards(r, speed, p, solid, clearance)
    r["target_speed"] = speed
    r["target_steer"] = steer
