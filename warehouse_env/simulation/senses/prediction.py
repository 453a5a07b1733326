"""Predictions: for every (speed level, lateral offset), the time until the body would touch a neighbour.

An optional slice of the observation. The own body moves as the path follower would drive the command: along its
manoeuvre or its route, back, or to a stop. Neighbours, those of the slice `neighbours`, go on at their speed along
theirs, which robots tell each other; they are as large as the largest robot of the fleet. Paths ignore shelves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part, whole
from warehouse_env.observation import NEIGHBOUR
from warehouse_env.simulation.driver.driving import FASTEST, FASTEST_BACK, LEAST_OFF, STEER_SLACK
from warehouse_env.simulation.driver.line import along_after, look_ahead, point_at, pursue, room_beside, way_point
from warehouse_env.simulation.driver.tracking import on_bend, searches
from warehouse_env.simulation.physics.geometry import (
    Rectangle,
    body_at,
    body_of,
    grown,
    rectangles_touch,
    separation,
    squared_distance,
)
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.kinematics import approach, curvature
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, sin_cos
from warehouse_env.simulation.senses.sensing import TURNED

SAMPLES = 8  # times looked at,
APART = np.float32(0.3)  # [s] between two of them
MARGIN = np.float32(0.03)  # [m] kept at first
MARGIN_RATE = np.float32(0.05)  # [m/s] added to it over time
KEPT = np.float32(0.01)  # [m] of a smaller present gap that may be lost
STAND, ALONG_ARCS, ALONG_LINE = range(3)  # what a command forwards does
_DIAGONAL = np.float32(1.4143)  # of a unit square, rounded up
_SIXTH, _OVER_24, _OVER_120, _OVER_720 = (np.float32(1.0 / n) for n in (6, 24, 120, 720))
_SHORT = np.float32(0.7)  # [rad] up to which the series holds
POSE = 4  # x, y [m] of a body's centre, cosine and sine of its heading


class Sights(NamedTuple):
    """What sensing and predictions write before they read it."""

    turned: NDArray[np.float32]  # see sensing.scan_shelves
    plans: NDArray[np.float32]  # [N, SAMPLES, POSE], where the robots' bodies will be if they go on
    who: NDArray[np.int32]  # [neighbours] robots in the slice `neighbours`; then those that the robot may meet,
    gaps: NDArray[np.float32]  # [neighbours] and the gaps to them [m]
    sides: NDArray[np.float32]  # [K] [m] of each command's lateral offset that there is room for
    path: NDArray[np.float32]  # [SAMPLES, POSE], where the own body will be under a command


def make_sights(robots: int, rays: int, neighbours: int, commands: int) -> Sights:
    """Return the scratch of sensing and predictions; commands: 0 if there are none."""
    return Sights(
        np.empty((TURNED, rays), np.float32),
        np.empty((robots if commands else 0, SAMPLES, POSE), np.float32),
        np.empty(neighbours, np.int32),
        np.empty(neighbours, np.float32),
        np.empty(commands, np.float32),
        np.empty((SAMPLES, POSE), np.float32),
    )


@inline
def _turned(c, s, turn):
    """Return the heading (cos, sin) half a turn [rad] and a turn on from the heading (c, s)."""
    half = HALF * turn
    q = half * half
    half_s, half_c = half * (ONE - q * (_SIXTH - q * _OVER_120)), ONE - q * (HALF - q * (_OVER_24 - q * _OVER_720))
    if abs(half) > _SHORT:
        half_s, half_c = sin_cos(half)
    mid_c, mid_s = c * half_c - s * half_s, s * half_c + c * half_s
    return mid_c, mid_s, mid_c * half_c - mid_s * half_s, mid_s * half_c + mid_c * half_s


@inline
def _driven(v, target, p):
    """Return ([m] driven in APART, the speed [m/s] then) of a robot that changes its speed from `v` to `target`."""
    reached = approach(v, target, p["max_acceleration"] * APART)
    if reached != target:
        return HALF * (v + reached) * APART, reached
    changing = abs(target - v) / p["max_acceleration"]
    return HALF * (v + target) * changing + target * (APART - changing), target


@inline
def _touches(k, body, others, p):
    """Whether the Rectangle `body` at time k touches one of the robots that it may meet; others: (count, Sights)."""
    count, sights = others
    margin = MARGIN + MARGIN_RATE * APART * np.float32(k + 1)
    far = p["radius"] + p["widest"] + _DIAGONAL * margin
    for n in range(count):
        plans, j = sights.plans, sights.who[n]
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
def _back(r, speed, p, path, others):
    """Write the path of a command to stop, or to back at `speed` < 0 [m/s] with the nose turning along the route."""
    motion, bearing = r["motion"], r["on_route"]["bearing"]
    x, y, c, s, v, steer = motion["x"], motion["y"], motion["cos"], motion["sin"], motion["speed"], motion["steer"]
    for k in range(SAMPLES):
        wanted = r["commanded"]["follow_steer"]
        if speed < ZERO and v <= ZERO:
            wanted = min(max(bearing, -p["max_steer"]), p["max_steer"])
        before, steer = steer, approach(steer, wanted, p["max_steer_rate"] * APART)
        way, v = _driven(v, speed, p)
        turn = way * curvature(HALF * (before + steer), p["wheelbase"])
        mid_c, mid_s, c, s = _turned(c, s, turn)
        bearing -= turn
        x, y = x + way * mid_c, y + way * mid_s
        body = body_of(x, y, c, s, p)
        _put(path, k, body)
        if _touches(k, body, others, p):
            return np.float32(k) / np.float32(SAMPLES)
    return ONE


@inline
def _along_arcs(r, arcs, speed, p, path, others):
    """Write the path of a command forwards in a manoeuvre; it goes slowly while it steers, and turns back at rest."""
    motion, manoeuvre = r["motion"], r["manoeuvre"]
    x, y, c, s, steer = motion["x"], motion["y"], motion["cos"], motion["sin"], motion["steer"]
    at, count, left = int(manoeuvre["arc"]), int(manoeuvre["arcs"]), manoeuvre["arc_left"]
    v = motion["speed"] if left > ZERO else -motion["speed"]
    for k in range(SAMPLES):
        before, steer = steer, approach(steer, arcs[at, 1], p["max_steer_rate"] * APART)
        off = abs(arcs[at, 1] - HALF * (before + steer))
        limit = min(speed, FASTEST if left > ZERO else FASTEST_BACK, STEER_SLACK / max(off, LEAST_OFF))
        to_go, v = _driven(v, limit, p)
        while to_go > ZERO and left != ZERO:
            stride = min(to_go, abs(left))
            to_go -= stride
            way = stride if left > ZERO else -stride
            mid_c, mid_s, c, s = _turned(c, s, way * curvature(arcs[at, 1], p["wheelbase"]))
            x, y, left = x + way * mid_c, y + way * mid_s, left - way
            if left == ZERO and at + 1 < count:
                at += 1
                left = arcs[at, 0]
                if left * way < ZERO:
                    to_go = v = ZERO
        body = body_of(x, y, c, s, p)
        _put(path, k, body)
        if _touches(k, body, others, p):
            return np.float32(k) / np.float32(SAMPLES)
    return ONE


@inline
def _along_line(r, route, speed, side, p, path, others):
    """Write the path of a command forwards along the route, `side` [m] to its left."""
    motion, points, spacing = r["motion"], r["on_route"]["points"], r["on_route"]["spacing"]
    x, y, c, s, v, steer = motion["x"], motion["y"], motion["cos"], motion["sin"], motion["speed"], motion["steer"]
    along = r["on_route"]["position"]
    for k in range(SAMPLES):
        tx, ty, ux, uy = point_at(route, points, spacing, along + look_ahead(max(v, ZERO), p), p["beyond"])
        wanted, _, _ = pursue(x, y, c, s, tx - side * uy, ty + side * ux, p)
        before, steer = steer, approach(steer, wanted, p["max_steer_rate"] * APART)
        way, v = _driven(v, on_bend(speed, wanted, before, p), p)
        mid_c, mid_s, c, s = _turned(c, s, way * curvature(HALF * (before + steer), p["wheelbase"]))
        x, y = x + way * mid_c, y + way * mid_s
        along = along_after(route, points, spacing, along, way, x, y)
        body = body_of(x, y, c, s, p)
        _put(path, k, body)
        if _touches(k, body, others, p):
            return np.float32(k) / np.float32(SAMPLES)
    return ONE


@inline
def _forwards(r, route, p):
    """Return what a command forwards makes a robot do: STAND and search, drive ALONG_ARCS or ALONG_LINE."""
    if r["task"]["alive"] == 0 or r["on_route"]["points"] < 2 or searches(r, route, p):
        return STAND
    return ALONG_ARCS if r["manoeuvre"]["arcs"] > 0 else ALONG_LINE


@inline
def _drive(r, ways, forwards, speed, side, p, path, others):
    """Write the path of a command until it touches one of `others`; return the share of the time till then.

    ways: (route, arcs); side [m]: what of its offset there is room for; others: see _touches.
    """
    route, arcs = ways
    if speed > ZERO and forwards == ALONG_LINE:
        return _along_line(r, route, speed, side, p, path, others)
    if speed > ZERO and forwards == ALONG_ARCS:
        return _along_arcs(r, arcs, speed, p, path, others)
    return _back(r, min(speed, ZERO), p, path, others)


@inline
def _room(r, route, side, p, floor):
    """Return what of a lateral offset [m] there is room for."""
    if side == ZERO:
        return ZERO
    tx, ty, ux, uy = way_point(r, route, look_ahead(max(r["motion"]["speed"], ZERO), p), p["beyond"])
    to_go = np.float32(r["on_route"]["points"] - 1) * r["on_route"]["spacing"] - r["on_route"]["position"]
    return room_beside(tx, ty, ux, uy, side, to_go, floor, p)


@part
def write_plans(worlds, b, vehicles, floor, sights):
    """Write where the robots of world b will be if they go on as they do, along their routes or manoeuvres."""
    params, kinds = vehicles
    for i in range(worlds.robots.shape[1]):
        r, route, p = worlds.robots[b, i], worlds.routes[b, i], kind_of(i, params[0], kinds)
        speed, forwards = r["motion"]["speed"], _forwards(r, route, p)
        if r["task"]["alive"] == 0:
            speed = ZERO
        if forwards == ALONG_ARCS:
            speed = abs(speed)
        side = _room(r, route, r["on_route"]["lateral"], p, floor)
        _drive(r, (route, worlds.arcs[b, i]), forwards, speed, side, p, sights.plans[i], (whole(0), sights))


@inline
def _may_meet(motion, plan, p):
    """Whether a robot may meet one that drives as planned, wherever it drives itself."""
    x, y, v = motion["x"], motion["y"], abs(motion["speed"])
    for k in range(SAMPLES):
        t = APART * np.float32(k + 1)
        driven = min(v + HALF * p["max_acceleration"] * t, p["max_speed"]) * t
        reach = driven + p["far"] + p["widest"] + _DIAGONAL * (MARGIN + MARGIN_RATE * t)
        dx, dy = plan[k, 0] - x, plan[k, 1] - y
        if dx * dx + dy * dy < reach * reach:
            return True
    return False


@inline
def _keep_near(motion, seen, sights, p):
    """Keep of the neighbours `seen` in `sights.who` those that the robot may meet; return how many."""
    count, own = 0, body_at(ZERO, ZERO, ONE, ZERO, p)
    for n in range(p["neighbours"]):
        at, j = n * NEIGHBOUR, sights.who[n]
        if seen[at + 6] == ZERO:
            break
        if _may_meet(motion, sights.plans[j], p):
            ahead, left = seen[at] * p["lidar_range"], seen[at + 1] * p["lidar_range"]
            other = Rectangle(ahead, left, seen[at + 2], seen[at + 3], p["widest_length"], p["widest_width"])
            sights.who[count], sights.gaps[count] = j, separation(own, other) / _DIAGONAL - KEPT
            count += 1
    return count


@inline
def _same(table, sides, a):
    """Return the first command of the speed before command a that has its side, or a."""
    k = a
    while k > 0 and table[k - 1, 0] == table[a, 0]:
        k -= 1
    while sides[k] != sides[a]:
        k += 1
    return k


@part
def write_predictions(worlds, at, row, starts, table, sights, p, floor):
    """Write the slice `predictions` of robot at = (b, i): the free share of the time for each command.

    row: the observation float32[D] with all other slices; starts: observation.Starts; table float32[K, 2]: commands
    (speed, offset) grouped by speed; sights: with the plans of all robots.
    """
    r, ways, sides = worlds.robots[at], (worlds.routes[at], worlds.arcs[at]), sights.sides
    out, forwards = row[starts.predictions :], _forwards(r, ways[0], p)
    count = _keep_near(r["motion"], row[starts.neighbours :], sights, p)
    for a in range(table.shape[0]):
        speed, sides[a] = table[a, 0], ZERO
        if count == 0:
            out[a] = ONE
            continue
        if speed > ZERO and forwards == ALONG_LINE:
            sides[a] = _room(r, ways[0], table[a, 1], p, floor)
        first = _same(table, sides, a)
        if first < a:
            out[a] = out[first]
        else:
            out[a] = _drive(r, ways, forwards, speed, sides[a], p, sights.path, (count, sights))
