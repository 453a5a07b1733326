"""Who waits for whom: each robot that stands, for who the protective field or the right of way says it does.

Where neither has named anybody, for the first body that its own would touch further along its route: geometry alone, so
that holds whatever moves the robots. The body is carried along the route as it would be driven: the front axle on the
line, the body along it, and what it stands off the line by, in place and heading, is driven out on the first metre.
Others are looked at where they are now. A chain of such robots is a queue; a cycle is a deadlock,
since each of its robots waits for another of them (a wait-for graph, Coffman et al. 1971).

Asked by pictures, the log of jams, and where right of way steps in only around such circles (stepping_in.py).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, kernel, part
from warehouse_env.simulation.physics.geometry import rectangles_touch
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO, arc_tan2, sin_cos, wrap
from warehouse_env.simulation.state import NOBODY

STANDING = np.float32(0.95)  # [s] without driving from which a robot is said to wait: 1 s, less its rounding
ROCKING = np.float32(4.95)  # [s] within a metre of one place from which it is, though it moves: 5 s
AHEAD = np.float32(2.5)  # [m] of route looked at
_STRIDE = np.float32(0.05)  # [m] between two poses looked at
_STRIDES = 50
_SETTLE = np.float32(1.0)  # [m] of driving that brings a robot onto its line


@inline
def _on_route(route, points, spacing, at):
    """Return the route's point at arc length `at` [m] and its direction (x, y, ux, uy); its last point at most."""
    k = min(int(at / spacing), points - 2)
    part = min(at / spacing - np.float32(k), ONE)
    dx, dy = route[k + 1, 0] - route[k, 0], route[k + 1, 1] - route[k, 1]
    return route[k, 0] + part * dx, route[k, 1] + part * dy, dx / spacing, dy / spacing


@inline
def _touched(cx, cy, c, s, near, count, robots, p):
    """Return the first of the robots near[:count] whose body a body at (cx, cy) [m], heading (c, s), touches."""
    half_length, half_width, offset = p["half_length"], p["half_width"], p["offset"]
    reach = p["radius"] + p["radius"]
    for k in range(count):
        o = robots[near[k]]
        dx, dy = o["x"] - offset * o["cos"] - cx, o["y"] - offset * o["sin"] - cy
        if dx * dx + dy * dy < reach * reach and rectangles_touch(
            dx, dy, c, s, half_length, half_width, o["cos"], o["sin"], half_length, half_width
        ):
            return near[k]
    return NOBODY


@inline
def _list_near(robots, i, p, near):
    """Write the robots whose body robot i's could meet within AHEAD into near int32[N]; return how many."""
    x, y = robots[i]["x"], robots[i]["y"]
    reach = AHEAD + _SETTLE + p["radius"] + p["radius"] + abs(p["offset"]) + abs(p["offset"])
    count = 0
    for j in range(robots.shape[0]):
        dx, dy = robots[j]["x"] - x, robots[j]["y"] - y
        if j != i and dx * dx + dy * dy < reach * reach:
            near[count] = j
            count += 1
    return count


@inline
def _stands(r):
    """Whether a robot that is not parked gets nowhere."""
    return r["alive"] != 0 and (r["waiting_time"] >= STANDING or r["standing_time"] >= ROCKING)


@part
def _first_in_the_way(robots, i, route, p, near):
    """Return the robot whose body robot i's would touch first along its route, or NOBODY."""
    r = robots[i]
    points, spacing = r["points"], r["spacing"]
    count = _list_near(robots, i, p, near)
    if count == 0 or points < 2:
        return NOBODY
    x, y, ux, uy = _on_route(route, points, spacing, r["position"])
    off_x, off_y = r["x"] - x, r["y"] - y
    turned = wrap(r["heading"] - arc_tan2(uy, ux))
    to_go = np.float32(points - 1) * spacing - r["position"]
    for k in range(1, _STRIDES + 1):
        ahead = np.float32(k) * _STRIDE
        if ahead > to_go:
            return NOBODY
        left = max(ZERO, ONE - ahead / _SETTLE)
        x, y, ux, uy = _on_route(route, points, spacing, r["position"] + ahead)
        s, c = sin_cos(left * turned)
        c, s = ux * c - uy * s, uy * c + ux * s
        cx, cy = x + left * off_x - p["offset"] * c, y + left * off_y - p["offset"] * s
        other = _touched(cx, cy, c, s, near, count, robots, p)
        if other != NOBODY:
            return other
    return NOBODY


@part
def waits_for(robots, i, route, p, near):
    """Return whom robot i of ROBOT[N] waits for, or NOBODY; route float32[R, 2] is its own, near int[N] scratch."""
    r = robots[i]
    if not _stands(r):
        return NOBODY
    if r["held_by"] != NOBODY:
        return r["held_by"]
    if r["yields_to"] != NOBODY:
        return r["yields_to"]
    return _first_in_the_way(robots, i, route, p, near)


@kernel
def _waits_for(robots, routes, params, out):
    """Write into out int32[B, N]; see jams_of."""
    near = np.empty(robots.shape[1], np.int32)
    for b in range(robots.shape[0]):
        for i in range(robots.shape[1]):
            out[b, i] = waits_for(robots[b], i, routes[b, i], params[0], near)


@kernel
def _cycles(waits, out):
    """Write into out int32[B, N]; see cycles. Each robot is walked over once: seen holds the walk it was met on."""
    worlds, count = waits.shape
    for b in range(worlds):
        seen = np.full(count, NOBODY, np.int32)
        out[b] = NOBODY
        for i in range(count):
            j = i
            while j != NOBODY and seen[j] == NOBODY:
                seen[j] = i
                j = waits[b, j]
            if j == NOBODY or seen[j] != i or out[b, j] != NOBODY:
                continue
            first, k = j, waits[b, j]
            while k != j:
                first = min(first, k)
                k = waits[b, k]
            out[b, j] = first
            k = waits[b, j]
            while k != j:
                out[b, k] = first
                k = waits[b, k]


class Jams(NamedTuple):
    """Who waits, int32[B, N] each; see jams_of."""

    waits_for: NDArray[np.int32]
    cycle: NDArray[np.int32]


def jams_of(robots: NDArray[Any], routes: NDArray[np.float32], params: NDArray[Any]) -> Jams:
    """Return for ROBOT[B, N] whom each robot waits for, and the lowest robot of the cycle it is on; NOBODY if none.

    Only a robot waits that has stood for a second or rocked for five, and nobody that is parked.
    routes float32[B, N, R, 2] [m]; params PARAMETERS[1].
    """
    waits = np.empty(robots.shape, dtype=np.int32)
    _waits_for(robots, routes, params, waits)
    return Jams(waits, cycles(waits))


def cycles(waits: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return int32[B, N]: the lowest robot of the cycle that a robot of waits int32[B, N] is on, NOBODY off all."""
    out = np.empty_like(waits)
    _cycles(waits, out)
    return out
