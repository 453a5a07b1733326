"""The robot in the way: the first body that a robot's own body would touch along its route.

This is geometry alone, whatever moves the robots. The body is carried along the route, front axle on the line; its
present offset from the line, in place and heading, fades out over the first metre. Others are taken where they are.
"""

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.driver.line import point_at
from warehouse_env.simulation.physics.geometry import body_of, rectangles_touch, squared_distance
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO, arc_tan2, sin_cos, wrap
from warehouse_env.simulation.state import NOBODY

AHEAD = np.float32(2.5)  # [m] of route looked at
_STRIDE = np.float32(0.05)  # [m] between two poses looked at
_STRIDES = 50
_ONTO_LINE = np.float32(1.0)  # [m] of driving that brings a robot onto its line


@inline
def _touched(body, near, robots, p, kinds):
    """Return the first of the robots `near` whose body the Rectangle `body` touches; p: parameters of that body."""
    for j in near:
        motion, kind = robots[j]["motion"], kind_of(j, p, kinds)
        other = body_of(motion["x"], motion["y"], motion["cos"], motion["sin"], kind)
        reach = p["radius"] + kind["radius"]
        if squared_distance(body, other) < reach * reach and rectangles_touch(body, other):
            return j
    return NOBODY


@inline
def _list_near(robots, i, p, kinds, near):
    """Write the robots that robot i could meet within AHEAD into near int32[N]; return how many."""
    x, y = robots[i]["motion"]["x"], robots[i]["motion"]["y"]
    count = 0
    for j in range(robots.shape[0]):
        dx, dy, other = robots[j]["motion"]["x"] - x, robots[j]["motion"]["y"] - y, kind_of(j, p, kinds)
        reach = AHEAD + _ONTO_LINE + p["radius"] + other["radius"] + abs(p["offset"]) + abs(other["offset"])
        if j != i and dx * dx + dy * dy < reach * reach:
            near[count] = j
            count += 1
    return count


@part
def first_in_the_way(robots, i, route, p, kinds, near):
    """Return the robot that robot i's body would touch first along its route, or NOBODY; p: parameters of i."""
    r = robots[i]
    motion, on_route = r["motion"], r["on_route"]
    points, spacing = on_route["points"], on_route["spacing"]
    count = _list_near(robots, i, p, kinds, near)
    if count == 0 or points < 2:
        return NOBODY
    x, y, ux, uy = point_at(route, points, spacing, on_route["position"], ZERO)
    off_x, off_y = motion["x"] - x, motion["y"] - y
    turned = wrap(motion["heading"] - arc_tan2(uy, ux))
    to_go = np.float32(points - 1) * spacing - on_route["position"]
    for k in range(1, _STRIDES + 1):
        ahead = np.float32(k) * _STRIDE
        if ahead > to_go:
            return NOBODY
        left = max(ZERO, ONE - ahead / _ONTO_LINE)
        x, y, ux, uy = point_at(route, points, spacing, on_route["position"] + ahead, ZERO)
        s, c = sin_cos(left * turned)
        c, s = ux * c - uy * s, uy * c + ux * s
        other = _touched(body_of(x + left * off_x, y + left * off_y, c, s, p), near[:count], robots, p, kinds)
        if other != NOBODY:
            return other
    return NOBODY
