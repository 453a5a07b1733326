"""Exact contact and distance of oriented rectangles, by separating axes. Scalars only."""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.physics.trigonometry import ZERO


@inline
def rectangles_touch(dx, dy, c1, s1, l1, w1, c2, s2, l2, w2):
    """Return whether two closed rectangles share a point.

    (dx, dy): centre 2 - centre 1 [m]; (c, s): cosine and sine of each heading; (l, w): half length and half width [m].
    """
    c = abs(c1 * c2 + s1 * s2)
    s = abs(c1 * s2 - s1 * c2)
    if abs(dx * c1 + dy * s1) > l1 + l2 * c + w2 * s:
        return False
    if abs(dy * c1 - dx * s1) > w1 + l2 * s + w2 * c:
        return False
    if abs(dx * c2 + dy * s2) > l2 + l1 * c + w1 * s:
        return False
    return abs(dy * c2 - dx * s2) <= w2 + l1 * s + w1 * c


@inline
def separation(dx, dy, c1, s1, l1, w1, c2, s2, l2, w2):
    """Return the widest gap [m] that an axis of either of two rectangles shows between them.

    Over 0 where `rectangles_touch` is False, and then between 0.7 of their distance and all of it.
    """
    c = abs(c1 * c2 + s1 * s2)
    s = abs(c1 * s2 - s1 * c2)
    long = max(abs(dx * c1 + dy * s1) - (l1 + l2 * c + w2 * s), abs(dx * c2 + dy * s2) - (l2 + l1 * c + w1 * s))
    wide = max(abs(dy * c1 - dx * s1) - (w1 + l2 * s + w2 * c), abs(dy * c2 - dx * s2) - (w2 + l1 * s + w1 * c))
    return max(long, wide)


@inline
def squared_distance_to_box(px, py, half_length, half_width):
    """Return the squared distance [m^2] of a point, in the rectangle's own frame, to it; 0 inside."""
    ex = abs(px) - half_length
    ey = abs(py) - half_width
    ex = ex if ex > ZERO else ZERO
    ey = ey if ey > ZERO else ZERO
    return ex * ex + ey * ey


@inline
def _nearest_corner(dx, dy, c1, s1, l1, w1, c2, s2, l2, w2):
    """Return the smallest squared distance of rectangle 2's corners to rectangle 1."""
    x = dx * c1 + dy * s1
    y = dy * c1 - dx * s1
    c = c1 * c2 + s1 * s2
    s = c1 * s2 - s1 * c2
    lx, ly = l2 * c, l2 * s
    wx, wy = -w2 * s, w2 * c
    a = squared_distance_to_box(x + lx + wx, y + ly + wy, l1, w1)
    b = squared_distance_to_box(x + lx - wx, y + ly - wy, l1, w1)
    d = squared_distance_to_box(x - lx + wx, y - ly + wy, l1, w1)
    e = squared_distance_to_box(x - lx - wx, y - ly - wy, l1, w1)
    return min(min(a, b), min(d, e))


@inline
def rectangle_gap(dx, dy, c1, s1, l1, w1, c2, s2, l2, w2):
    """Return the distance [m] between two rectangles, 0 where they touch (arguments as rectangles_touch).

    Disjoint convex polygons are nearest at a corner of one of them.
    """
    if rectangles_touch(dx, dy, c1, s1, l1, w1, c2, s2, l2, w2):
        return ZERO
    first = _nearest_corner(dx, dy, c1, s1, l1, w1, c2, s2, l2, w2)
    second = _nearest_corner(-dx, -dy, c2, s2, l2, w2, c1, s1, l1, w1)
    return np.sqrt(min(first, second))


@inline
def ray_to_rectangle(ox, oy, ux, uy, half_length, half_width):
    """Return the distance along a ray (unit vector u from o, in the rectangle's own frame) to it, or inf.

    Slabs without branches; a ray that starts inside returns 0. 0/0 gives nan, which no comparison takes.
    """
    ax = (-half_length - ox) / ux
    bx = (half_length - ox) / ux
    ay = (-half_width - oy) / uy
    by = (half_width - oy) / uy
    near_x = ax if ax < bx else bx
    far_x = bx if ax < bx else ax
    near_y = ay if ay < by else by
    far_y = by if ay < by else ay
    near = near_x if near_x > near_y else near_y
    far = far_x if far_x < far_y else far_y
    near = near if near > ZERO else ZERO
    return near if near <= far else np.float32(np.inf)
