"""Who is in a robot's way: the first body that its own would touch further along its route.

Geometry alone, so it holds whatever moves the robots. The body is carried along the route as it would be driven: the
front axle on the line, the body along it, and what it stands off the line by, in place and heading, is driven out on
the first metre. Others are looked at where they are now.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.driver.line import point_at
from warehouse_env.simulation.physics.geometry import rectangles_touch
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO, arc_tan2, sin_cos, wrap
from warehouse_env.simulation.state import NOBODY

AHEAD = np.float32(2.5)  # [m] of route looked at
_STRIDE = np.float32(0.05)  # [m] between two poses looked at
_STRIDES = 50
_ONTO_LINE = np.float32(1.0)  # [m] of driving that brings a robot onto its line


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
    reach = AHEAD + _ONTO_LINE + p["radius"] + p["radius"] + abs(p["offset"]) + abs(p["offset"])
    count = 0
    for j in range(robots.shape[0]):
        dx, dy = robots[j]["x"] - x, robots[j]["y"] - y
        if j != i and dx * dx + dy * dy < reach * reach:
            near[count] = j
            count += 1
    return count


@part
def first_in_the_way(robots, i, route, p, near):
    """Return the robot whose body robot i's would touch first along its route, or NOBODY."""
    r = robots[i]
    points, spacing = r["points"], r["spacing"]
    count = _list_near(robots, i, p, near)
    if count == 0 or points < 2:
        return NOBODY
    x, y, ux, uy = point_at(route, points, spacing, r["position"], ZERO)
    off_x, off_y = r["x"] - x, r["y"] - y
    turned = wrap(r["heading"] - arc_tan2(uy, ux))
    to_go = np.float32(points - 1) * spacing - r["position"]
    for k in range(1, _STRIDES + 1):
        ahead = np.float32(k) * _STRIDE
        if ahead > to_go:
            return NOBODY
        left = max(ZERO, ONE - ahead / _ONTO_LINE)
        x, y, ux, uy = point_at(route, points, spacing, r["position"] + ahead, ZERO)
        s, c = sin_cos(left * turned)
        c, s = ux * c - uy * s, uy * c + ux * s
        cx, cy = x + left * off_x - p["offset"] * c, y + left * off_y - p["offset"] * s
        other = _touched(cx, cy, c, s, near, count, robots, p)
        if other != NOBODY:
            return other
    return NOBODY
