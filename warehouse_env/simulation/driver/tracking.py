"""The path follower under every discrete and continuous action: pure pursuit that respects the swept body.

An action asks for a speed and a lateral offset from the route. The follower steers towards a point ahead, slows down in
turns, and accepts a command only if the body, driven on and then braked, stays clear of the shelves. The map is known,
so this needs no learning. Where the route cannot be followed (it begins behind the robot, a corner is too sharp, a lane
ends), the follower requests a manoeuvre back to the route (`seeks`); the search runs after the env step
(traffic/recovery.py). The follower ignores other robots, except that it requests a way around their bodies once one has
blocked it for HELD seconds.
"""

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.driver import arrival
from warehouse_env.simulation.driver.driving import KEPT, NARROW, STANDS, drive_arcs, give_up, leads_ahead
from warehouse_env.simulation.driver.line import aim, look_ahead, room_beside, steer_for, to_go, way_point
from warehouse_env.simulation.driver.off_shelves import may_drive
from warehouse_env.simulation.physics.footprint import sweep_is_free
from warehouse_env.simulation.physics.geometry import Pose
from warehouse_env.simulation.physics.kinematics import curvature
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO
from warehouse_env.simulation.state import ALONE, AROUND_OTHERS

CREEP = np.float32(0.35)  # [m/s] at least, however much it must steer
SLOW = np.float32(0.45)  # [m/s] under which another steering angle may be chosen
BEND_SCALE = np.float32(2.0)  # [rad] of steering at which the speed falls to CREEP,
STEER_SCALE = np.float32(0.9)  # [rad] of steering error at which it does
MARGIN = np.float32(0.03)  # [m] the follower keeps from shelves
STEERED = np.float32(0.02)  # [rad] of steering error from which a robot in a manoeuvre waits
LAST = np.float32(1.5e-4)  # [m] to shelves under which a manoeuvre is given up
BACK_ON = np.float32(0.5)  # [rad] off the nose within which target and line end a manoeuvre that only leads forwards
PATIENCE = np.float32(4.0)  # [s] without a metre of progress after which manoeuvres are completed
ASIDE = np.float32(1.0)  # [rad] off the nose from which a target needs a manoeuvre
AGAIN = np.float32(2.0)  # [s] from one search to the next,
AGAIN_HELD = np.float32(5.0)  # [s] and around other robots, plus the time without progress: searches become rarer
HELD = np.float32(2.5)  # [s] held by others after which it searches a way around them
_BACK_ROOM = np.float32(0.6)  # [m] that it can back with the steering held
_BACK_APART, _BACK_TRIES = np.float32(0.3), 15  # [rad] between steering angles that are tried, from lock to lock


@inline
def _brake_steer(r, steer, margin, p, floor):
    """Return the steering angle to brake with: the wanted one if its sweep is free, otherwise the present one."""
    if r["motion"]["speed"] == ZERO or may_drive(r, ZERO, steer, margin, p, floor):
        return steer
    return r["motion"]["steer"]


@inline
def _manoeuvre(r, arcs, wanted, stopping, p, floor):
    """Return (speed, steering) along the arcs; give up a manoeuvre that is no longer free.

    If the planned margin cannot be kept, it is lowered, and raised again as soon as possible. Otherwise a robot that
    starts beside a shelf would drive all its arcs that close; in one of 170 episodes one wedged itself.
    """
    motion, manoeuvre = r["motion"], r["manoeuvre"]
    speed, steer = drive_arcs(r, arcs, wanted, stopping, p)
    if manoeuvre["arcs"] == 0:
        return ZERO, motion["steer"]
    margin = manoeuvre["arc_margin"]
    if may_drive(r, speed, steer, margin, p, floor):
        more = min(margin / KEPT, manoeuvre["arc_planned"])  # farther on there is room as planned
        if more > margin and may_drive(r, speed, steer, more, p, floor):
            manoeuvre["arc_margin"] = more
        return speed, steer
    steered = abs(steer - motion["steer"]) < STEERED  # else it steers first
    if abs(motion["speed"]) < STANDS and wanted > ZERO and steered:
        manoeuvre["arc_margin"] *= KEPT  # too near at the start
        if manoeuvre["arc_margin"] < LAST:
            give_up(r)
    return ZERO, _brake_steer(r, steer, manoeuvre["arc_margin"], p, floor)


@inline
def _forward(r, alone, speed, steer, angle, p, floor):
    """Return the wanted (speed, steering) if its sweep is free, else those of stopping; seek a manoeuvre if need be."""
    manoeuvre = r["manoeuvre"]
    slow = abs(r["motion"]["speed"]) < SLOW
    may = not (slow and abs(angle) > ASIDE) and may_drive(r, speed, steer, MARGIN, p, floor)
    if slow and not (may and alone) and manoeuvre["search_wait"] <= ZERO:
        manoeuvre["seeks"] = ALONE if alone else AROUND_OTHERS
        manoeuvre["search_wait"] = AGAIN if alone else AGAIN_HELD + r["clocks"]["stalled_time"]
    if may:
        return speed, steer
    return ZERO, _brake_steer(r, steer, MARGIN, p, floor)


@inline
def back_steer(r, p, floor):
    """Return the steering angle to back with: the nearest to the route's bearing with which there is room to back."""
    motion, most = r["motion"], p["max_steer"]
    along = min(max(r["on_route"]["bearing"], -most), most)
    pose = Pose(motion["x"], motion["y"], motion["heading"], motion["cos"], motion["sin"])
    for k in range(_BACK_TRIES):
        off = _BACK_APART * np.float32((k + 1) // 2)
        steer = along - off if k % 2 == 0 else along + off
        bend, way = curvature(steer, p["wheelbase"]), -_BACK_ROOM * p["length_scale"]
        if abs(steer) <= most and sweep_is_free(pose, bend, way, MARGIN, p, floor):
            return steer
    return along


@inline
def _backwards(r, speed, p, floor):
    """Return (speed, steering) of backing, or of stopping before a shelf."""
    steer = back_steer(r, p, floor)
    if may_drive(r, speed, steer, MARGIN, p, floor):
        return speed, steer
    return ZERO, _brake_steer(r, steer, MARGIN, p, floor)


@inline
def on_bend(speed, steer, steered, fastest):
    """Return the speed [m/s] driven, `speed` or less, while steering at `steered` [rad] towards `steer`.

    fastest [m/s]: that of the robot straight ahead.
    """
    bend = max(abs(steer) / BEND_SCALE, abs(steer - steered) / STEER_SCALE)
    return min(speed, CREEP + (fastest - CREEP) * max(ZERO, ONE - bend))


@inline
def _alone(r, p):
    """Whether no other robot keeps the robot from its way.

    Without the shield it stands clear of others by itself. That counts in a manoeuvre; on its line it may queue.
    """
    clocks = r["clocks"]
    held = max(clocks["contact_time"], r["shield"]["vetoed_time"])
    if p["field"] == 0 and r["manoeuvre"]["arcs"] > 0:
        held = max(held, clocks["waiting_time"])
    return held <= HELD


@inline
def searches(r, route, p):
    """Whether a command forwards only makes the robot stand and search a manoeuvre."""
    if r["manoeuvre"]["arcs"] > 0:
        return not _alone(r, p) and r["manoeuvre"]["search_wait"] <= ZERO
    tx, ty, _, _ = way_point(r, route, look_ahead(max(r["motion"]["speed"], ZERO), p), p["beyond"])
    return abs(r["motion"]["speed"]) < SLOW and abs(steer_for(r, tx, ty, p)[1]) > ASIDE


@inline
def _rejoins(r, arcs, angle, command, p, floor):
    """Whether a robot leaves a manoeuvre that only leads forwards, since it may follow its route by a command."""
    manoeuvre, (speed, steer) = r["manoeuvre"], command
    aligned = max(abs(angle), abs(r["on_route"]["bearing"])) < BACK_ON and r["clocks"]["stalled_time"] < PATIENCE
    aligned = aligned and manoeuvre["docks"] == 0
    if not (aligned and leads_ahead(r, arcs) and may_drive(r, speed, steer, MARGIN, p, floor)):
        return False
    # MARGIN is not checked at the start, where the tail may swing into a shelf
    return manoeuvre["arc_margin"] >= NARROW or may_drive(r, speed, steer, ZERO, p, floor)


@inline
def follow(r, route, arcs, wanted_speed, offset, stopping, p, floor):
    """Set target_speed, target_steer and follow_steer from a wanted speed [m/s] and lateral offset [m].

    stopping: see step.Features.
    """
    commanded, manoeuvre = r["commanded"], r["manoeuvre"]
    tx, ty, ux, uy, angle = aim(r, route, p)
    if stopping is not None and manoeuvre["arcs"] > 0 and manoeuvre["docks"] != 0:
        wanted_speed = max(wanted_speed, ZERO)  # backing off would begin the docking anew
    manoeuvre["search_wait"] = max(manoeuvre["search_wait"] - p["time_step"], ZERO)
    commanded["wanted_speed"], commanded["wanted_offset"] = wanted_speed, offset
    steer, speed, on_line = commanded["follow_steer"], wanted_speed, wanted_speed
    if offset != ZERO:
        offset = room_beside(tx, ty, ux, uy, offset, to_go(r), floor, p)
        steer, angle = steer_for(r, tx - offset * uy, ty + offset * ux, p)
    alone = _alone(r, p)
    if speed > ZERO:
        if not alone and manoeuvre["search_wait"] <= ZERO:
            give_up(r)
        on_line = on_bend(speed, steer, r["motion"]["steer"], p["max_speed"])
        if stopping is not None:
            on_line = min(on_line, arrival.speed_on_line(r, p))
            if manoeuvre["arcs"] == 0 and manoeuvre["search_wait"] <= ZERO and arrival.wants_to_dock(r):
                manoeuvre["seeks"], manoeuvre["search_wait"] = ALONE if alone else AROUND_OTHERS, AGAIN
        if _rejoins(r, arcs, angle, (on_line, steer), p, floor):
            give_up(r)
    stops = speed == ZERO or speed < ZERO < r["motion"]["speed"]
    if stops and p["field"] == 0 and r["motion"]["speed"] != ZERO:
        speed, steer = ZERO, r["motion"]["steer"]  # so that others know where it will stand
    elif manoeuvre["arcs"] > 0 and speed >= ZERO:  # a robot that backs keeps its manoeuvre for later
        speed, steer = _manoeuvre(r, arcs, speed, stopping, p, floor)
    elif speed > ZERO:
        speed, steer = _forward(r, alone, on_line, steer, angle, p, floor)
    elif stops:
        speed, steer = ZERO, _brake_steer(r, steer, MARGIN, p, floor)
    else:
        speed, steer = _backwards(r, speed, p, floor)
    commanded["target_speed"], commanded["target_steer"] = speed, steer
