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
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO, arc_tan2, sin_cos, wrap
from warehouse_env.simulation.state import NOBODY

AHEAD = np.float32(2.5)  # [m] of route looked at
_STRIDE = np.float32(0.05)  # [m] between two poses looked at
_STRIDES = 50
_ONTO_LINE = np.float32(1.0)  # [m] of driving that brings a robot onto its line


@inline
def _touched(cx, cy, c, s, near, count, robots, p, kinds):
    """Return the first of the robots near[:count] whose body a body at (cx, cy) [m], heading (c, s), touches."""
    for k in range(count):
        o, other = robots[near[k]], kind_of(near[k], p, kinds)
        reach, offset = p["radius"] + other["radius"], other["offset"]
        dx, dy = o["x"] - offset * o["cos"] - cx, o["y"] - offset * o["sin"] - cy
        if dx * dx + dy * dy < reach * reach and rectangles_touch(
            dx, dy, c, s, p["half_length"], p["half_width"], o["cos"], o["sin"],
            other["half_length"], other["half_width"],
        ):  # fmt: skip
            return near[k]
    return NOBODY


@inline
def _list_near(robots, i, p, kinds, near):
    """Write the robots whose body robot i's could meet within AHEAD into near int32[N]; return how many."""
    x, y = robots[i]["x"], robots[i]["y"]
    count = 0
    for j in range(robots.shape[0]):
        dx, dy, other = robots[j]["x"] - x, robots[j]["y"] - y, kind_of(j, p, kinds)
        reach = AHEAD + _ONTO_LINE + p["radius"] + other["radius"] + abs(p["offset"]) + abs(other["offset"])
        if j != i and dx * dx + dy * dy < reach * reach:
            near[count] = j
            count += 1
    return count


@part
def first_in_the_way(robots, i, route, p, kinds, near):
    """Return the robot whose body robot i's would touch first along its route, or NOBODY; p: its own."""
    r = robots[i]
    points, spacing = r["points"], r["spacing"]
    count = _list_near(robots, i, p, kinds, near)
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
        other = _touched(cx, cy, c, s, near, count, robots, p, kinds)
        if other != NOBODY:
            return other
    return NOBODY
