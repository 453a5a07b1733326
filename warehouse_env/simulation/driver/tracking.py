"""The path follower under every discrete and continuous action: pure pursuit that respects the swept body.

An action asks for a speed and a lateral offset from the route. The follower steers towards a point ahead
(pure pursuit about the fixed front axle), slows down where it must steer, and takes a command only if the
body, driven on and then braked, stays off the shelves: the map is known, so this needs no learning. Where the line
cannot be followed so (it begins behind the robot, a corner is too sharp, a lane ends) it asks for a manoeuvre that
leads to the route (`seeks`), which is searched for after the env step (rejoin.py), and drives that. Other robots are
not its business, but that it asks for a way round their bodies once one has held it for a second.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.driver.driving import KEPT, STANDS, drive_arcs, give_up, leads_ahead
from warehouse_env.simulation.driver.off_shelves import may_drive
from warehouse_env.simulation.physics.footprint import clearance_at
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, arc_tan, arc_tan2, wrap
from warehouse_env.simulation.state import ALONE, AROUND_OTHERS

TWO = np.float32(2.0)
LOOK_AHEAD = np.float32(0.55)  # [m] standing
LOOK_AHEAD_TIME = np.float32(0.45)  # [s] of driving added to it
CREEP = np.float32(0.35)  # [m/s] at least, however much it must steer
SLOW = np.float32(0.45)  # [m/s] under which another steering angle may be chosen
BEND_SCALE = np.float32(2.0)  # [rad] of steering at which the speed would come down to a creep,
STEER_SCALE = np.float32(0.9)  # [rad] and off the wanted steering
MARGIN = np.float32(0.03)  # [m] the follower keeps from shelves
STEERED = np.float32(0.02)  # [rad] off the wanted steering from which a robot in a manoeuvre waits for it to turn
LAST = np.float32(1.5e-4)  # [m] that a manoeuvre must keep from shelves, or it is given up
LANE_CLEARANCE = np.float32(0.45)  # [m] a way-point moved sideways keeps from shelves
OFFSET_FADE = np.float32(2.0)  # [m] before the goal in which offsets fade out
BACK_ON = np.float32(0.5)  # [rad] off the nose up to which target and line end a manoeuvre that only leads on ahead
PATIENCE = np.float32(4.0)  # [s] without a metre of progress from which manoeuvres are driven to their end
ASIDE = np.float32(1.0)  # [rad] off the nose from which a target takes a manoeuvre
AGAIN = np.float32(2.0)  # [s] from one search to the next, whatever came of it,
AGAIN_HELD, AGAIN_HELD_BACK = np.float32(15.0), np.float32(5.0)  # [s] and where another is in the way, longer by the
# time that it has got nowhere: what has not helped so far is tried more and more rarely
HELD = np.float32(1.0)  # [s] in touch with a robot after which a way round the others' bodies is searched,
HELD_BACK = np.float32(2.5)  # [s] and held by the field after which it is, too: it may have to steer first


@inline
def locate(r, route):
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
def way_point(r, route, ahead):
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
def to_steering(bend, wheelbase, most):
    """Return the rear-wheel angle [rad] that drives a curvature [1/m], within +-most."""
    return min(max(-arc_tan(wheelbase * bend), -most), most)


@inline
def pursue(r, tx, ty, p):
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


@inline
def aim(r, route, p):
    """Set follow_steer towards a point of the route ahead; return that, the direction there, and the angle to it."""
    ahead = LOOK_AHEAD + LOOK_AHEAD_TIME * max(r["speed"], ZERO)
    tx, ty, ux, uy = way_point(r, route, ahead)
    r["follow_steer"], angle = pursue(r, tx, ty, p)
    return tx, ty, ux, uy, angle


@inline
def _brake_steer(r, steer, margin, p, solid, clearance):
    """The steering angle to brake with: the wanted one if its sweep is free, else the present one, free before."""
    if r["speed"] == ZERO or may_drive(r, ZERO, steer, margin, p, solid, clearance):
        return steer
    return r["steer"]


@inline
def _manoeuvre(r, arcs, wanted, p, solid, clearance):
    """Return (speed, steering) along the arcs; give the manoeuvre up where it is no longer free.

    Where the planned margin cannot be kept it is lowered, and raised again as soon as it can be: where it was not, a
    robot that began beside a shelf drove all its arcs as near to shelves, and in one of 170 episodes one wedged itself.
    """
    speed, steer = drive_arcs(r, arcs, wanted, p)
    if r["arcs"] == 0:
        return ZERO, r["steer"]
    margin = r["arc_margin"]
    if may_drive(r, speed, steer, margin, p, solid, clearance):
        more = min(margin / KEPT, r["arc_planned"])  # further on there is more room, as planned
        if more > margin and may_drive(r, speed, steer, more, p, solid, clearance):
            r["arc_margin"] = more
        return speed, steer
    if abs(r["speed"]) < STANDS and wanted > ZERO and abs(steer - r["steer"]) < STEERED:  # else it steers first
        r["arc_margin"] *= KEPT  # too near at the start
        if r["arc_margin"] < LAST:
            give_up(r)
    return ZERO, _brake_steer(r, steer, r["arc_margin"], p, solid, clearance)


@inline
def _forward(r, alone, speed, steer, angle, p, solid, clearance):
    """Return the wanted (speed, steering) if its sweep is free, else those of stopping; seek a manoeuvre if need be."""
    slow = abs(r["speed"]) < SLOW
    may = not (slow and abs(angle) > ASIDE) and may_drive(r, speed, steer, MARGIN, p, solid, clearance)
    if slow and not (may and alone) and r["search_wait"] <= ZERO:
        r["seeks"] = ALONE if alone else AROUND_OTHERS
        again_held = AGAIN_HELD_BACK if p["field"] else AGAIN_HELD
        r["search_wait"] = AGAIN if alone else again_held + r["stalled_time"]
    if may:
        return speed, steer
    return ZERO, _brake_steer(r, steer, MARGIN, p, solid, clearance)


@inline
def _backwards(r, speed, p, solid, clearance):
    """Return (speed, steering) of backing with the nose along the route, or of stopping before a shelf."""
    steer = min(max(r["bearing"], -p["max_steer"]), p["max_steer"])
    if may_drive(r, speed, steer, MARGIN, p, solid, clearance):
        return speed, steer
    return ZERO, _brake_steer(r, steer, MARGIN, p, solid, clearance)


@inline
def follow(r, route, arcs, wanted_speed, offset, p, solid, clearance):
    """Set target_speed, target_steer and follow_steer from a wanted speed [m/s] and lateral offset [m]."""
    tx, ty, ux, uy, angle = aim(r, route, p)
    r["search_wait"] = max(r["search_wait"] - p["time_step"], ZERO)
    steer = r["follow_steer"]
    if offset != ZERO:
        to_go = np.float32(r["points"] - 1) * r["spacing"] - r["position"]
        offset *= min(ONE, to_go / OFFSET_FADE)
        if clearance_at(tx - offset * uy, ty + offset * ux, clearance, p["cell"]) < LANE_CLEARANCE:
            offset *= HALF
            if clearance_at(tx - offset * uy, ty + offset * ux, clearance, p["cell"]) < LANE_CLEARANCE:
                offset = ZERO
        steer, angle = pursue(r, tx - offset * uy, ty + offset * ux, p)
    speed = on_line = wanted_speed
    alone = r["contact_time"] <= HELD and r["held_time"] <= HELD_BACK
    if speed > ZERO:
        if not alone and r["search_wait"] <= ZERO:
            give_up(r)
        bend = max(abs(steer) / BEND_SCALE, abs(steer - r["steer"]) / STEER_SCALE)
        on_line = min(speed, CREEP + (p["max_speed"] - CREEP) * max(ZERO, ONE - bend))
        aligned = max(abs(angle), abs(r["bearing"])) < BACK_ON and r["stalled_time"] < PATIENCE
        if aligned and leads_ahead(r, arcs) and may_drive(r, on_line, steer, MARGIN, p, solid, clearance):
            give_up(r)
    if r["arcs"] > 0 and speed >= ZERO:  # one that backs has its manoeuvre left for when it drives on
        speed, steer = _manoeuvre(r, arcs, speed, p, solid, clearance)
    elif speed > ZERO:
        speed, steer = _forward(r, alone, on_line, steer, angle, p, solid, clearance)
    elif r["speed"] > ZERO or speed == ZERO:
        speed, steer = ZERO, _brake_steer(r, steer, MARGIN, p, solid, clearance)
    else:
        speed, steer = _backwards(r, speed, p, solid, clearance)
    r["target_speed"] = speed
    r["target_steer"] = steer
