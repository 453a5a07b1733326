"""Plans: where each robot will be in the next seconds if it continues. Robots tell each other their plans.

A robot keeps its speed, or reaches the higher one that it wants. It drives as the path follower would: along its route
at its lateral offset (without the shield: the one that it wants), along its manoeuvre, backwards, or to a stop, also
before a shelf. It may brake at any time. Without the shield, a command conflicts unless the robot and others that it
may meet can still brake after it.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part, whole
from warehouse_env.simulation.driver.driving import drive_arcs, leads_ahead
from warehouse_env.simulation.driver.line import aim, locate, look_ahead, pursue, room_beside, to_go, way_point
from warehouse_env.simulation.driver.off_shelves import may_drive
from warehouse_env.simulation.driver.tracking import BACK_ON, MARGIN, PATIENCE, back_steer, on_bend, searches
from warehouse_env.simulation.physics.geometry import Rectangle, body_of, grown, rectangles_touch, squared_distance
from warehouse_env.simulation.physics.kinds import kind_of, many_alike
from warehouse_env.simulation.physics.kinematics import approach, curvature, roll
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, sin_cos
from warehouse_env.simulation.senses import on_routes
from warehouse_env.simulation.senses.on_routes import APART, LANES, driven, turned
from warehouse_env.simulation.senses.sensing import TURNED
from warehouse_env.simulation.state import ROBOT

SAMPLES = 12  # times looked at, APART of each other: at 0.3 s, bodies that met passed unseen between two
KEPT = np.float32(0.03)  # [m] from others at first, and
KEPT_RATE = np.float32(0.05)  # [m/s] added to it over time
DIAGONAL = np.float32(1.4143)  # of a unit square, rounded up
STAND, ALONG_ARCS, ALONG_LINE = range(3)  # what a command forwards does
POSE = 4  # x, y [m] of a body's centre, cosine and sine of its heading


class Sights(NamedTuple):
    """What sensing, plans and predictions write before they read it."""

    turned: NDArray[np.float32]  # see sensing.scan_shelves
    plans: NDArray[np.float32]  # [N, SAMPLES, POSE]
    stops: NDArray[np.float32]  # [N, SAMPLES, POSE] if all brake now; without the shield
    who: NDArray[np.int32]  # [neighbours] robots in the slice `neighbours`; then those that the robot may meet,
    gaps: NDArray[np.float32]  # [neighbours] and the gaps to them [m]
    sides: NDArray[np.float32]  # [K] [m] of each command's lateral offset that there is room for
    asked: NDArray[np.float32]  # [K, 3] their next steps (speed, steering), and whether the follower drives them
    path: NDArray[np.float32]  # [SAMPLES, POSE], where the own body will be under a command,
    probe: Any  # ROBOT[1] or a copy of the robot; or under several at a time, along the route, in
    lanes: NDArray[np.float32]  # the lanes of on_routes,
    lane_of: NDArray[np.int32]  # [LANES] which commands these are, or which robots
    coming: NDArray[np.int32]  # see passages.Passages, [P, 2] robots that drive through each, by their direction
    free_ways: NDArray[np.float32]  # [N] [m] that each robot may drive before a passage that another comes along


class Met(NamedTuple):
    """The robots that one may meet: the first `count` of sights.who, of them the first `braking` even if all brake."""

    count: Any
    braking: Any
    sights: Sights


def make_sights(robots: int, rays: int, neighbours: int, commands: int, passages: int) -> Sights:
    """Return the scratch of sensing and predictions; commands, passages: 0 if there are no predictions."""
    return Sights(
        np.empty((TURNED, rays), np.float32), np.empty((robots if commands else 0, SAMPLES, POSE), np.float32),
        np.empty((robots if commands else 0, SAMPLES, POSE), np.float32), np.empty(neighbours, np.int32),
        np.empty(neighbours, np.float32), np.empty(commands, np.float32), np.empty((commands, 3), np.float32),
        np.empty((SAMPLES, POSE), np.float32), np.empty(1, ROBOT), np.zeros(on_routes.ROWS * LANES, np.float32),
        np.empty(LANES, np.int32), np.empty((passages, 2), np.int32), np.empty(robots if commands else 0, np.float32),
    )  # fmt: skip


@inline
def touches(k, body, plans, count, sights, p):
    """Whether the Rectangle `body` at time k touches one of the first `count` robots in sights.who, as in `plans`."""
    margin = KEPT + KEPT_RATE * APART * np.float32(k + 1)
    far = p["radius"] + p["widest"] + DIAGONAL * margin
    for n in range(count):
        j = sights.who[n]
        other = Rectangle(
            plans[j, k, 0], plans[j, k, 1], plans[j, k, 2], plans[j, k, 3], p["widest_length"], p["widest_width"]
        )
        near = squared_distance(body, other) < far * far
        if near and rectangles_touch(grown(body, min(margin, sights.gaps[n])), other):
            return True
    return False


@inline
def _put(path, k, body):
    """Write a body's place on a path."""
    path[k, 0], path[k, 1], path[k, 2], path[k, 3] = body.x, body.y, body.c, body.s


@inline
def can_brake(state, met, p):
    """Return the share of the time until a robot touches another if both brake; state: x, y, cos, sin, speed, steering.

    The other brakes now, the robot after a step that ends in this state.
    """
    x, y, c, s, v, steer = state
    bend = curvature(steer, p["wheelbase"])
    for k in range(SAMPLES):
        if touches(k, body_of(x, y, c, s, p), met.sights.stops, met.braking, met.sights, p):
            return np.float32(k) / np.float32(SAMPLES)
        way, v = driven(v, ZERO, p["max_acceleration"])
        mid_c, mid_s, c, s = turned(c, s, way * bend)
        x, y = x + way * mid_c, y + way * mid_s
    return ONE


@inline
def _back(r, speed, p, path, met, floor):
    """Write the path of a command to stop, or to back up at `speed` < 0 [m/s] as the path follower does."""
    motion, bearing, aside, most = r["motion"], ZERO, ZERO, p["max_steer"]
    if speed < ZERO:
        bearing = r["on_route"]["bearing"]
        aside = back_steer(r, p, floor) - min(max(bearing, -most), most)
    x, y, c, s, v, steer = motion["x"], motion["y"], motion["cos"], motion["sin"], motion["speed"], motion["steer"]
    free = ONE
    for k in range(SAMPLES):
        wanted = r["commanded"]["follow_steer"] if p["field"] != 0 else steer
        if speed < ZERO and v <= ZERO:
            wanted = min(max(min(max(bearing, -most), most) + aside, -most), most)
        before, steer = steer, approach(steer, wanted, p["max_steer_rate"] * APART)
        way, v = driven(v, speed, p["max_acceleration"])
        turn = way * curvature(HALF * (before + steer), p["wheelbase"])
        mid_c, mid_s, c, s = turned(c, s, turn)
        bearing -= turn
        x, y = x + way * mid_c, y + way * mid_s
        body = body_of(x, y, c, s, p)
        _put(path, k, body)
        if k == 0 and met.braking > 0:
            free = can_brake((x, y, c, s, v, steer), met, p)
        if touches(k, body, met.sights.plans, met.count, met.sights, p):
            return min(free, np.float32(k) / np.float32(SAMPLES))
    return free


@inline
def _drive_on(r, route, arcs, speed, p, floor):
    """Drive a copy of a robot on for APART, along its manoeuvre until that leads to the line, then along the route."""
    motion, manoeuvre = r["motion"], r["manoeuvre"]
    if manoeuvre["arcs"] == 0 or leads_ahead(r, arcs):
        locate(r, route)
        _, _, _, _, angle = aim(r, route, p)
        aligned = max(abs(angle), abs(r["on_route"]["bearing"])) < BACK_ON and r["clocks"]["stalled_time"] < PATIENCE
        if manoeuvre["arcs"] > 0 and aligned and speed > ZERO:
            steer = r["commanded"]["follow_steer"]
            on_line = on_bend(speed, steer, motion["steer"], p["max_speed"])
            if may_drive(r, on_line, steer, MARGIN, p, floor):
                manoeuvre["arcs"] = 0
    target, steer = ZERO, motion["steer"]
    if manoeuvre["arcs"] > 0:
        target, steer = drive_arcs(r, arcs, speed, None, p)
    if manoeuvre["arcs"] == 0:
        steer = r["commanded"]["follow_steer"]
        target = on_bend(speed, steer, motion["steer"], p["max_speed"])
    way, motion["speed"] = driven(motion["speed"], target, p["max_acceleration"])
    before = motion["steer"]
    motion["steer"] = approach(before, steer, p["max_steer_rate"] * APART)
    bend = curvature(HALF * (before + motion["steer"]), p["wheelbase"])
    motion["x"], motion["y"], motion["heading"] = roll(motion["x"], motion["y"], motion["heading"], way, bend)
    motion["sin"], motion["cos"] = sin_cos(motion["heading"])


@inline
def _along_arcs(r, ways, speed, p, path, met, floor):
    """Write the path of a command in a manoeuvre that does not back."""
    probe, (route, arcs), free = met.sights.probe, ways, ONE
    probe[0] = r
    for k in range(SAMPLES):
        _drive_on(probe[0], route, arcs, speed, p, floor)
        motion = probe[0]["motion"]
        x, y, c, s = motion["x"], motion["y"], motion["cos"], motion["sin"]
        body = body_of(x, y, c, s, p)
        _put(path, k, body)
        if k == 0 and met.braking > 0:
            free = can_brake((x, y, c, s, motion["speed"], motion["steer"]), met, p)
        if touches(k, body, met.sights.plans, met.count, met.sights, p):
            return min(free, np.float32(k) / np.float32(SAMPLES))
    return free


@inline
def off_line(r, ways, forwards, speed, p, path, met, floor):
    """Write the path of a command that does not lead along the route; return the share of the time that it is free.

    ways: (route, arcs); forwards: see what_forwards; met: a Met.
    """
    if forwards == ALONG_ARCS and (speed > ZERO or (speed == ZERO and p["field"] != 0)):
        return _along_arcs(r, ways, speed, p, path, met, floor)
    return _back(r, min(speed, ZERO), p, path, met, floor)


@inline
def what_forwards(r, route, p):
    """Return what a command forwards makes a robot do: STAND and search, drive ALONG_ARCS or ALONG_LINE."""
    if r["task"]["alive"] == 0 or r["on_route"]["points"] < 2 or searches(r, route, p):
        return STAND
    return ALONG_ARCS if r["manoeuvre"]["arcs"] > 0 else ALONG_LINE


@inline
def point_ahead(r, route, p):
    """Return the point of its route (x, y, ux, uy) that a robot steers for."""
    return way_point(r, route, look_ahead(max(r["motion"]["speed"], ZERO), p), p["beyond"])


@inline
def side_room(r, ahead, side, p, floor):
    """Return the part of a lateral offset [m] that fits beside the point ahead."""
    tx, ty, ux, uy = ahead
    return room_beside(tx, ty, ux, uy, side, to_go(r), floor, p)


@inline
def step_towards(r, ahead, speed, side, p):
    """Return the (speed [m/s], steering [rad]) after the next physics step of a command along the route."""
    motion, (tx, ty, ux, uy) = r["motion"], ahead
    x, y, c, s = motion["x"], motion["y"], motion["cos"], motion["sin"]
    steer, _, _ = pursue(x, y, c, s, tx - side * uy, ty + side * ux, p["wheelbase"], p["max_steer"])
    speed = on_bend(speed, steer, motion["steer"], p["max_speed"])
    return (
        approach(motion["speed"], speed, p["max_acceleration"] * p["time_step"]),
        approach(motion["steer"], steer, p["max_steer_rate"] * p["time_step"]),
    )


@inline
def body_in(lanes, k, p):
    """Return the body in a lane."""
    x, y = lanes[on_routes.X * LANES + k], lanes[on_routes.Y * LANES + k]
    return body_of(x, y, lanes[on_routes.COS * LANES + k], lanes[on_routes.SIN * LANES + k], p)


@inline
def _plan_lines(worlds, b, count, p, sights):
    """Write the plans of the `count` robots in the lanes, of one kind."""
    robots, routes, lanes, who = worlds.robots[b], worlds.routes[b], sights.lanes, sights.lane_of
    for k in range(SAMPLES):
        for n in range(count):
            on_routes.aim(lanes, n, robots[who[n]]["on_route"], routes[who[n]], p)
        on_routes.drive(lanes, p)
        for n in range(count):
            on_routes.settle(lanes, n, robots[who[n]]["on_route"], routes[who[n]])
            _put(sights.plans[who[n]], k, body_in(lanes, n, p))


@inline
def _plan(worlds, b, i, lane, p, floor, sights):
    """Write the plan of robot i, or put it into a lane if it drives along its route; return whether it does."""
    r, route, wanted = worlds.robots[b, i], worlds.routes[b, i], worlds.robots[b, i]["commanded"]["wanted_speed"]
    ways, nobody = (route, worlds.arcs[b, i]), Met(whole(0), whole(0), sights)
    speed, forwards = r["motion"]["speed"], what_forwards(r, route, p)
    if p["field"] == 0:
        off_line(r, ways, forwards, ZERO, p, sights.stops[i], nobody, floor)
    if r["task"]["alive"] == 0:
        speed = ZERO
    elif forwards == ALONG_ARCS and wanted >= ZERO:
        speed = max(abs(speed), wanted)
    elif forwards == ALONG_LINE and wanted > ZERO:
        speed = max(speed, wanted)
    if forwards == ALONG_LINE and speed > ZERO:
        ahead, offset = point_ahead(r, route, p), r["on_route"]["lateral"]
        if p["field"] == 0:
            offset = r["commanded"]["wanted_offset"]
        side = side_room(r, ahead, offset, p, floor)
        next_speed, next_steer = step_towards(r, ahead, speed, side, p)
        if may_drive(r, next_speed, next_steer, MARGIN, p, floor):
            on_routes.begin(sights.lanes, lane, r, speed, side)
            sights.lane_of[lane] = i
            return 1
        speed = ZERO
    off_line(r, ways, forwards, speed, p, sights.plans[i], nobody, floor)
    return 0


@part
def write_plans(worlds, b, some, vehicles, floor, sights):
    """Write the plans of some robots of world b; some: (first, after the last)."""
    (params, kinds), (begin, last) = vehicles, some
    while begin < last:
        p, count = kind_of(begin, params[0], kinds), 0
        end = begin + many_alike(begin, last, kinds, LANES)
        for i in range(begin, end):
            count += _plan(worlds, b, i, count, p, floor, sights)
        _plan_lines(worlds, b, count, p, sights)
        begin = end
